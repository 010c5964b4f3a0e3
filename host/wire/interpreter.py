"""Messages become typed events: which stream a result belongs to, what is lost, what answers reveal.

`parser.LiveParser` finds the messages in the bytes; every rule on their meaning stands here, so that a live
port and a recording follow the same.
"""

from __future__ import annotations

from typing import Any

from firmware_py import geometry, messages, wire
from palpate.wire.accounting import WINDOW, LinkCounts, Sequence, StreamCounts, StrokesTold
from palpate.wire.clock import Unwrapper
from palpate.wire.delivery import Again, Earlier
from palpate.wire.events import (
    Answer,
    Boot,
    Estimate,
    Event,
    Features,
    Frame,
    Log,
    StreamEnd,
    StrokeState,
    TactileMap,
)
from palpate.wire.reference import kept
from palpate.wire.scale import NOMINAL, CalibrationPieces, CellScale

STREAMS_KEPT = 64

_FRAME = messages.TYPE["frame"]
_STATE = messages.TYPE["stroke_state"]
_MAP = messages.TYPE["map"]
_ESTIMATE = messages.TYPE["estimate"]
_LOG = messages.TYPE["log"]
_BOOT = messages.TYPE["boot"]
_FEATURES = messages.TYPE["features"]
_STREAM_END = messages.TYPE["stream_end"]
_IDENTIFIED = messages.TYPE["identify"] | messages.ANSWER
_STREAM_STARTED = messages.TYPE["stream_start"] | messages.ANSWER
_STREAM_RENEWED = messages.TYPE["stream_renew"] | messages.ANSWER
_STREAM_STOPPED = messages.TYPE["stream_stop"] | messages.ANSWER
_READ_BACK = messages.TYPE["read_back"] | messages.ANSWER
_CALIBRATED = messages.TYPE["calibrate"] | messages.ANSWER
_FLASHED = messages.TYPE["flash_confirm"] | messages.ANSWER
_REFERENCE = messages.TYPE["reference"] | messages.ANSWER
_IDENTITY = messages.TABLE[_IDENTIFIED][3].split()
_BOOTS_AT, _FEATURES_AT = _IDENTITY.index("boots"), _IDENTITY.index("features_version")


class Interpreter:
    """Messages in the wire's order in, events out, every sequence number accounted for.

    Parameters
    ----------
    own_only : bool
        As `parser.LiveParser` takes it.
    """

    def __init__(self, own_only: bool = False) -> None:
        self.counts = LinkCounts()
        self.frames = Sequence()
        self.scale: CellScale = NOMINAL
        """What frames are decoded with: the probe's calibration, once it was read back on this wire."""
        self.reference: tuple[int, int, int] | None = None
        """The reference press that the probe keeps, as far as this wire told (`palpate.wire.reference`)."""
        self.streams: dict[int, None] = {}
        """The streams begun, or renewed, on this wire: what belongs to another is no result of ours."""
        self.strokes = StrokesTold()
        self.streaming = False
        """Between the answers to stream_start and stream_stop."""
        self._pieces = CalibrationPieces()
        self._sent = wire.Receiver(messages.COMMAND_BODY)
        self._next_every = 1
        self._next_content = messages.CONTENT_STROKES
        self._estimates = True  # False for a probe that only streams
        self._clock = Unwrapper()
        self._event_seq: int | None = None
        self._results: dict[tuple[type, int, int], None] = {}
        self._own_only = own_only
        self._boots: int | None = None
        self._ends_before: int | None = None

    @property
    def frame_counts(self) -> StreamCounts:
        """Received, lost, duplicate, late frames."""
        return self.frames.counts

    def commanded(self, raw: bytes) -> None:
        """A command that went out, as on the wire: some determine what the stream will be."""
        self._sent.length = 0
        at = 0
        while at < len(raw):
            at = self._sent.feed(raw, at, len(raw))
            if self._sent.length and self._sent.packet[0] == messages.TYPE["stream_start"]:
                fields = messages.unpack(self._sent.packet, self._sent.length)
                if fields is not None:
                    self._next_content = fields[0]
                    self._next_every = max(1, fields[1])

    def told_calibration(self, blob: bytes) -> None:
        """A recording's attached calibration; what the probe itself sends takes precedence."""
        scale = CellScale()
        if not self.scale.calibrated and scale.load(blob):
            self.scale = scale

    def settle(self) -> None:
        """The wire is quiet: whatever is still missing of a stopped stream is lost."""
        if self._ends_before is not None:
            self.frames.expect_until(self._ends_before)
            self._ends_before = None

    def restarted(self) -> None:
        """The probe restarted: so do its sequence numbers, clock and stroke numbers."""
        self.frames.restart()
        self.frames.counts.restarts += 1
        self._clock = Unwrapper()
        self.reference = None
        self._event_seq = None
        self._results.clear()
        self.streaming = False
        self._ends_before = None

    def event(self, body: bytearray, length: int, host_ns: int) -> Event | None:
        """What the message in the first `length` bytes of `body` tells; None if it tells nothing."""
        kind = body[0]
        values = messages.unpack(body, length)
        if values is None:
            if kind in messages.TABLE:
                self.counts.unreadable += 1
            else:
                self.counts.unknown += 1
            return None
        if kind == _FRAME:
            return self._frame(kind, values, host_ns)
        if kind & messages.ANSWER:
            answer = Answer(host_ns, kind, messages.message_id(body), messages.answer_status(body), values)
            self._learn(answer)
            return answer
        return self._unsolicited(kind, values, host_ns)

    def _learn(self, answer: Answer) -> None:
        """What answers reveal about streams and calibration, in the wire's own order: a replay learns the
        same."""
        if answer.status < 0:
            return
        if answer.kind == _IDENTIFIED:
            self._booted(answer.values[_BOOTS_AT])
            self._estimates = answer.values[_FEATURES_AT] > 0
        elif answer.kind == _READ_BACK:
            self.scale = self._pieces.add(*answer.values) or self.scale
        elif answer.kind == _CALIBRATED:
            self._pieces.forget()
            self.reference = None
        elif answer.kind == _FLASHED:
            self.reference = None
        elif answer.kind == _REFERENCE:
            self.reference = kept(answer.values)
        elif answer.kind in (_STREAM_STARTED, _STREAM_RENEWED):
            number, next_seq, next_stroke = answer.values[:3]
            if answer.kind == _STREAM_STARTED and not self.streaming:
                # While a stream runs (an answer sent again, a reconnect), the numbers go on: a gap is a loss.
                self.settle()
                self.frames.every = self._next_every
                self.frames.expect_from(next_seq)
            self._stream_runs(number, next_stroke)
        elif answer.kind == _STREAM_STOPPED:
            self._stream_ended(*answer.values[:3])

    def _stream_runs(self, number: int, next_stroke: int) -> None:
        self.streaming = True
        if number not in self.streams:
            self.streams[number] = None
            if len(self.streams) > STREAMS_KEPT:
                del self.streams[next(iter(self.streams))]
            if self._estimates and self._next_content & messages.CONTENT_STROKES:
                self.strokes.begin(number, next_stroke)

    def _stream_ended(self, number: int, next_seq: int, next_stroke: int) -> None:
        if self.streaming:
            self.streaming = False
            self._ends_before = next_seq
            self.strokes.end(number, next_stroke)

    def _booted(self, boots: int) -> None:
        if self._boots is not None and self._boots != boots:
            self.restarted()
        self._boots = boots

    def _frame(self, kind: int, values: tuple[Any, ...], host_ns: int) -> Frame | None:
        seq, time_us, position_um, displacement_um, *more, packed = values
        if kind == _FRAME and len(packed) != geometry.FRAME_BYTES:
            self.counts.unreadable += 1
            return None
        if not self.frames.add(seq):
            return None
        time_us = self._clock(time_us, host_ns // 1000)
        gap, scale = self.frames.gap, self.scale
        return Frame(host_ns, seq, time_us, position_um, displacement_um, packed, gap, scale, tuple(more))

    def _unsolicited(self, kind: int, values: tuple[Any, ...], host_ns: int) -> Event | None:
        if kind == _STATE:
            event_seq, stream, stroke, state, time_us, frame_seq, value = values
            if not self._next_state(event_seq) or (self.streams and stream not in self.streams):
                return None
            word = messages.STATES.get(state, f"state_{state}")
            time_us = self._clock(time_us, host_ns // 1000)
            return StrokeState(host_ns, event_seq, stream, stroke, word, time_us, frame_seq, value)
        if kind == _STREAM_END:
            stream, reason, next_seq, next_stroke, time_us = values
            if stream in self.streams:
                self._stream_ended(stream, next_seq, next_stroke)
            word = messages.ENDS.get(reason, f"reason {reason}")
            time_us = self._clock(time_us, host_ns // 1000)
            return StreamEnd(host_ns, stream, word, next_seq, next_stroke, time_us)
        if kind == _BOOT:
            self._booted(values[0])
            return Boot(host_ns, *values)
        if kind == _LOG:
            level, time_us, text = values
            return Log(host_ns, level, self._clock(time_us, host_ns // 1000), text.decode("utf-8", "replace"))
        if kind == _MAP:
            return self._result(TactileMap(host_ns, *values))
        if kind == _FEATURES:
            return self._result(Features(host_ns, *values))
        if kind == _ESTIMATE:
            return self._result(Estimate(host_ns, *values))
        return None  # a command's type: an echo of our own bytes, or a chatty other program

    def _next_state(self, number: int) -> bool:
        """Count the stroke states that are missing (their numbers count modulo 2^16)."""
        if self._event_seq is not None:
            ahead = (number - self._event_seq + (1 << 15)) % (1 << 16) - (1 << 15)
            if ahead <= 0:
                return False
            self.counts.states_lost += ahead - 1
        self._event_seq = number
        return True

    def _result(self, event: TactileMap | Features | Estimate) -> Event:
        """A stroke's result; a duplicate is passed on as `Again`, to be acknowledged again."""
        known = self._own_only or self.streams or not self.frames.counts.received
        if known and event.stream not in self.streams:
            return Earlier(event.host_ns, event)
        key = (type(event), event.stream, event.stroke)
        if key in self._results:
            self.counts.resent += 1
            return Again(event.host_ns, event)
        self._results[key] = None
        if isinstance(event, Estimate):
            self.strokes.came(event.stream, event.stroke)
        if len(self._results) > 3 * WINDOW:  # a map, features and an estimate of each stroke
            del self._results[next(iter(self._results))]
        return event
