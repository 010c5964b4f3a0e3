"""A recording that can be attached to a live line and taken off again."""

from __future__ import annotations

import threading

from palpate.recording.writer import RecordingWriter
from palpate.wire.events import Event


class LiveRecorder:
    """Passes the link's traffic on to a recording, while one is running."""

    def __init__(self) -> None:
        self.writer: RecordingWriter | None = None
        self._lock = threading.Lock()

    def give_up(self, writer: RecordingWriter) -> bool:
        """Detach this recording; False if it is no longer attached."""
        with self._lock:
            if self.writer is not writer:
                return False
            self.writer = None
            return True

    def received(self, raw: bytes, event: Event | None, host_ns: int) -> None:
        """Bytes from the probe."""
        if (writer := self.writer) is not None:
            writer.received(raw, event, host_ns)

    def sent(self, raw: bytes, host_ns: int) -> None:
        """Bytes to the probe."""
        if (writer := self.writer) is not None:
            writer.sent(raw, host_ns)

    def mark(self, event: Event) -> None:
        """A gap, or somebody's mark."""
        if (writer := self.writer) is not None:
            writer.mark(event)

    def check(self) -> None:
        """Raise what ended the recording early, if one is running."""
        if (writer := self.writer) is not None:
            writer.check()
