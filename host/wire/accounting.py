"""Every sequence number accounted for: what came, what is missing, what came twice, what came late."""

from __future__ import annotations

from dataclasses import asdict, dataclass

WRAP = 1 << 30
"""Sequence numbers count modulo 2^30 on the probe."""
WINDOW = 256
"""A number this far behind the newest may still be late or a duplicate; further back the count restarted."""


@dataclass
class StreamCounts:
    """What the host counted of one stream.

    Parameters
    ----------
    received : int
        Different messages accepted.
    lost : int
        Numbers that never came, so far.
    duplicate : int
        Messages received before; they are dropped.
    late : int
        Messages that came after a newer one; each had been counted as lost and no longer is.
    restarts : int
        Times the numbers started again (the probe was reset).
    """

    received: int = 0
    lost: int = 0
    duplicate: int = 0
    late: int = 0
    restarts: int = 0

    def as_dict(self) -> dict[str, int]:
        """All of them by their names."""
        return asdict(self)


@dataclass
class LinkCounts:
    """What this end of the link has counted since it was opened.

    Parameters
    ----------
    packets, bytes_received : int
        Good packets, and all bytes.
    bad_crc, bad_frame, oversize, unreadable : int
        Damaged packets: wrong checksum, impossible stuffing, too long, not of their type's length.
    unknown : int
        Messages of a type that this program does not know: of a newer firmware.
    resent : int
        Results of a stroke that came again because an acknowledgement was late.
    states_lost : int
        Stroke states that never came.
    strokes_received, strokes_lost : int
        Estimates of this client's streams that came, and those that have not (some may still come).
    late_answers : int
        Answers that came after their command had given up; they are dropped.
    commands, retries : int
        Commands sent, and repetitions.
    queue_dropped : int
        Frames dropped, oldest first, because the program that reads them was too slow.
    reconnects : int
        Times the link came back.
    """

    packets: int = 0
    bytes_received: int = 0
    bad_crc: int = 0
    bad_frame: int = 0
    oversize: int = 0
    unreadable: int = 0
    unknown: int = 0
    resent: int = 0
    states_lost: int = 0
    strokes_received: int = 0
    strokes_lost: int = 0
    late_answers: int = 0
    commands: int = 0
    retries: int = 0
    queue_dropped: int = 0
    reconnects: int = 0

    def as_dict(self) -> dict[str, int]:
        """All of them by their names."""
        return asdict(self)


class Sequence:
    """Counts one stream by its sequence numbers modulo 2^30; needs 32 bytes however long it runs."""

    def __init__(self) -> None:
        self.counts = StreamCounts()
        self._newest: int | None = None
        self._seen = 0  # bit k: newest - k has come
        self.every = 1
        """The stream sends each n-th number; those between are not missing."""
        self.gap = 0
        """Messages skipped just before the last accepted message."""

    def add(self, number: int) -> bool:
        """Count one message; False if it is a duplicate (which must not be used again)."""
        self.gap = 0
        counts = self.counts
        if self._newest is None:
            self._begin(number)
            return True
        ahead = (number - self._newest + WRAP // 2) % WRAP - WRAP // 2
        if self.every > 1:
            ahead = -(-ahead // self.every)  # in messages; rounded up, since the first may be off the grid
        if ahead > 0:
            self.gap = ahead - 1
            counts.lost += self.gap
            self._seen = (self._seen << ahead | 1) & ((1 << WINDOW) - 1) if ahead < WINDOW else 1
            self._newest = number
            counts.received += 1
            return True
        if -ahead >= WINDOW:
            counts.restarts += 1
            self._begin(number)
            return True
        if self._seen >> -ahead & 1:
            counts.duplicate += 1
            return False
        self._seen |= 1 << -ahead
        counts.received += 1
        counts.late += 1
        counts.lost -= 1
        return True

    def expect_from(self, number: int) -> None:
        """A stream begins with `number`: earlier ones are not missing, all from it on are expected."""
        self._begin((number - 1) % WRAP)
        self.counts.received -= 1

    def expect_until(self, number: int) -> None:
        """A stream has ended before `number`: whatever has not arrived is lost."""
        if self._newest is not None:
            ahead = (number - 1 - self._newest + WRAP // 2) % WRAP - WRAP // 2
            ahead //= self.every
            if ahead > 0:
                self.counts.lost += ahead
                self._newest = (number - 1) % WRAP
                self._seen = self._seen << ahead & ((1 << WINDOW) - 1) if ahead < WINDOW else 0

    def restart(self) -> None:
        """The stream starts again (a new connection): the next number is not a gap."""
        self._newest = None
        self._seen = 0

    def _begin(self, number: int) -> None:
        # Numbers before the first were never expected: they count as received, not as lost.
        self._newest = number
        self._seen = (1 << WINDOW) - 1
        self.counts.received += 1


class StrokesTold:
    """Which strokes of each stream have brought their estimate: they are numbered without gaps."""

    KEPT = 8
    """Streams that are still counted; of older ones nothing comes any more."""

    def __init__(self) -> None:
        self._streams: dict[int, Sequence] = {}
        self._received = self._lost = 0

    def begin(self, stream: int, next_stroke: int) -> None:
        """A stream begins; `next_stroke` is its first."""
        self._streams[stream] = Sequence()
        self._streams[stream].expect_from(next_stroke)
        if len(self._streams) > self.KEPT:
            counts = self._streams.pop(next(iter(self._streams))).counts
            self._received += counts.received
            self._lost += counts.lost

    def end(self, stream: int, next_stroke: int) -> None:
        """It has ended before `next_stroke`."""
        if stream in self._streams:
            self._streams[stream].expect_until(next_stroke)

    def came(self, stream: int, stroke: int) -> None:
        """An estimate that had not come before."""
        if stream in self._streams:
            self._streams[stream].add(stroke)

    @property
    def received(self) -> int:
        """Estimates that have come."""
        return self._received + sum(s.counts.received for s in self._streams.values())

    @property
    def lost(self) -> int:
        """Estimates that have not, of strokes that are over."""
        return self._lost + sum(s.counts.lost for s in self._streams.values())
