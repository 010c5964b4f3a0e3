"""What a line reports to a recording."""

from __future__ import annotations

from typing import Protocol

from palpate.wire.events import Event


class Recorder(Protocol):
    """Receives all that a line carries; `palpate.recording.writer.RecordingWriter` is one."""

    def received(self, raw: bytes, event: Event | None, host_ns: int) -> None:
        """Bytes from the probe up to and including the packet that made `event` (None: no packet)."""

    def sent(self, raw: bytes, host_ns: int) -> None:
        """Bytes to the probe."""

    def mark(self, event: Event) -> None:
        """Something that did not come over the wire: the link went down, or is up again."""

    def check(self) -> None:
        """Raise what ended the recording early (`DiskFull`), if anything did."""
