"""A recording as a source of events: the live parser reads it, in the order in which things happened."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from mcap.records import Attachment, Message

from firmware_py import geometry, messages, status, tables
from palpate.errors import NotAProbe
from palpate.recording import channels
from palpate.recording.reader import Recording
from palpate.wire.delivery import Again, Earlier
from palpate.wire.events import Answer, Event, Gap, Log
from palpate.wire.identity import Identity
from palpate.wire.parser import LineNoise, LiveParser
from palpate.wire.source import EventSource

_LONGEST_GAP_S = 1e9
_VERSION = re.compile(r"[0-9]{1,3}(\.[0-9]{1,3}){2}")
_IDENTIFIED = messages.TYPE["identify"] | messages.ANSWER


class RecordedSession(EventSource):
    """The events of a recorded session, as the live probe's client had them.

    Parameters
    ----------
    path : str or Path
        The .mcap file, finished or not.

    Attributes
    ----------
    recording : Recording
        The file: its metadata, its attachments, where it is damaged.
    identified : bool
        False where no handshake was recorded, or none whole; `identity` is then what is known besides.

    Raises
    ------
    NoSuchFile, NotARecording
        It is not there, or something else.
    NotAProbe
        It holds nothing from a probe.
    VersionMismatch
        The recorded probe speaks another protocol.
    """

    live = False

    def __init__(self, path: str | Path) -> None:
        super().__init__(str(path), LiveParser())
        self.recording = Recording(path)
        self._calibration = self._first_calibration()
        self._parser.told_calibration(self._calibration)
        known = self._first_identity()
        self.identified = known is not None
        self._identity = known or self._noted_identity()
        self._identity.check()

    @property
    def identity(self) -> Identity:
        """Who answered the recording's first handshake, as far as that is known."""
        return self._identity

    def events(self, timeout_s: float | None = None) -> Iterator[Event]:
        """Every event from the beginning, as fast as it can be read; counts and scale start over, too."""
        self._parser = parser = LiveParser()
        parser.told_calibration(self._calibration)  # it may stand behind the first frames
        for topic, record in self.recording.records():
            if isinstance(record, Attachment) and record.name == channels.CALIBRATION:
                parser.told_calibration(record.data)
            elif not isinstance(record, Message):
                continue
            elif topic == channels.WIRE_IN:
                for event in parser.feed(record.data, record.log_time):
                    if not isinstance(event, Answer | Again | Earlier | LineNoise):
                        yield event
            elif topic == channels.WIRE_OUT:
                parser.commanded(record.data)
            elif topic == channels.LINK and (gap := _gap_of(record.log_time, record.data)) is not None:
                yield gap
            elif topic == channels.LOG and (mark := _mark_of(record.log_time, record.data)) is not None:
                yield mark
        parser.settle()

    def close(self) -> None:
        """Nothing is held open between events."""

    def _first_calibration(self) -> bytes:
        attached = (r for _, r in self.recording.records() if isinstance(r, Attachment))
        return next((r.data for r in attached if r.name == channels.CALIBRATION), b"")

    def _first_identity(self) -> Identity | None:
        """Who answered the first handshake; None where none was recorded, or none whole."""
        parser = LiveParser()
        for host_ns, _, raw in self.recording.wire():
            for event in parser.feed(raw, host_ns):
                if isinstance(event, Answer) and event.kind == _IDENTIFIED and event.status >= 0:
                    return Identity.from_answer(event.values)
        return None

    def _noted_identity(self) -> Identity:
        """What the recording's words say of the probe; a recording can be read without knowing."""
        words = self.recording.metadata()
        if "session" not in words and next(self.recording.wire(channels.WIRES), None) is None:
            raise NotAProbe(f"{self.name} holds nothing from a probe; it is not a recording of one")
        said = words.get("probe", {})
        protocol, firmware = said.get("protocol", ""), said.get("firmware", "")
        return Identity(
            protocol=int(protocol) if protocol.isdecimal() and len(protocol) < 9 else tables.PROTOCOL,
            schema=tables.SCHEMA,
            firmware=firmware if _VERSION.fullmatch(firmware) else "0.0.0",
            serial=said.get("serial", ""),
            rows=geometry.ROWS,
            columns=geometry.COLUMNS,
            pitch_mm=geometry.PITCH_UM / 1000,
            bits=geometry.BITS,
            capabilities=(),
            features_version=0,
            model_status=status.NO_MODEL,
            model_id=said.get("model_id", ""),
            boots=0,
            time_us=0,
        )


def open_recording(path: str | Path) -> RecordedSession:
    """Open a recording: its events, the probe's identity, its calibration and the link's counts.

        with open_recording("visit.mcap") as session:
            for event in session.events():
                ...

    Parameters
    ----------
    path : str or Path
        An .mcap file of `palpate stream --record` or of the viewer, finished or not.

    Raises
    ------
    NoSuchFile, NotARecording, NotAProbe, VersionMismatch
        It cannot be read; the sentence says why.
    """
    return RecordedSession(path)


def _mark_of(host_ns: int, text: bytes) -> Log | None:
    """The mark that a line of the log is; None for what the wire tells itself."""
    told = channels.read_json(text).get("message")
    line = Log(host_ns, 0, 0, told if isinstance(told, str) else "")
    return None if line.mark is None else line


def _gap_of(host_ns: int, text: bytes) -> Gap | None:
    """The gap that a message of the link's topic tells; None for what the wire tells itself."""
    told = channels.read_json(text)
    match told:
        case {
            "event": "up" | "down" as way,
            "seconds": int() | float() as seconds,
            "reason": str() as reason,
        }:
            if not 0 <= seconds < _LONGEST_GAP_S:  # nor NaN, nor an integer that no float holds
                return None
            return Gap(host_ns, float(seconds), reason, way == "up", told.get("restarted") is True)
    return None
