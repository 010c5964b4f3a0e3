"""A recording as a transport: the client of a live probe reads it unchanged."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Message

from firmware_py import messages
from host.errors import LinkGone, NotLive
from host.link.events import Answer, Gap
from host.link.parser import LiveParser
from host.record import channels
from host.record.reader import Recording

_IDENTIFIED = messages.TYPE["identify"] | messages.ANSWER


class PlaybackTransport:
    """Gives what the probe sent, packet by packet, as fast as it is asked for.

    Attributes
    ----------
    host_ns : int
        When the bytes just read had reached the host.
    """

    live = False

    def __init__(self, path: str | Path) -> None:
        self.recording = Recording(path)
        self.name = str(path)
        self.host_ns = 0
        self.mark: Gap | None = None
        """A gap in the link, where the recording has one instead of bytes."""
        self.command = b""
        """A command that the host had sent, where the recording has one instead of bytes."""
        self.calibration = b""
        """An attached calibration, where the recording has one instead of bytes."""
        self._records = self.recording.records()

    @property
    def identity(self) -> tuple[Any, ...] | None:
        """The fields of the first identify answer in it, or None."""
        parser = LiveParser()
        for host_ns, _, raw in self.recording.wire():
            for event in parser.feed(raw, host_ns):
                if isinstance(event, Answer) and event.kind == _IDENTIFIED and event.status >= 0:
                    return event.values
        return None

    def read(self, timeout_s: float) -> bytes:
        self.mark, self.command, self.calibration = None, b"", b""
        for topic, record in self._records:
            if isinstance(record, Attachment) and record.name == channels.CALIBRATION:
                self.calibration = record.data
                return b""
            if not isinstance(record, Message):
                continue
            self.host_ns = record.log_time
            if topic == channels.WIRE_IN:
                return record.data
            if topic == channels.WIRE_OUT:
                self.command = record.data
                return b""
            if topic == channels.LINK:
                self.mark = gap_of(self.host_ns, record.data)
                return b""
        raise LinkGone(f"{self.name} has ended")

    def write(self, data: bytes) -> None:
        raise NotLive(f"{self.name} is a recording: nothing can be sent to it")

    def close(self) -> None:
        self._records.close()


def gap_of(host_ns: int, text: bytes) -> Gap | None:
    """The gap that a message of the link's topic tells; None for what the wire tells itself."""
    words = json.loads(text)
    if words["event"] not in ("up", "down"):
        return None
    return Gap(host_ns, words["seconds"], words["reason"], words["event"] == "up", words["restarted"])
