"""Every sequence number accounted for: what came, what is missing, what came twice, what came late."""

from __future__ import annotations

from dataclasses import asdict, dataclass

WRAP = 1 << 30
"""Sequence numbers count modulo 2^30 on the probe."""
WINDOW = 256
"""A number this far behind the newest may still be a late or doubled one; further back it restarted."""


@dataclass
class Counts:
    """What the host counted of one stream.

    Parameters
    ----------
    received : int
        Different messages accepted.
    lost : int
        Numbers that never came, so far.
    duplicate : int
        Messages that had come before; they are dropped.
    late : int
        Messages that came after a younger one; each was counted lost before and is no longer.
    restarts : int
        Times the numbers began anew (the probe was reset).
    """

    received: int = 0
    lost: int = 0
    duplicate: int = 0
    late: int = 0
    restarts: int = 0

    def as_dict(self) -> dict[str, int]:
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
    resent : int
        Results of a stroke that came again because an acknowledgement was late.
    states_lost : int
        Stroke states that never came.
    late_answers : int
        Answers nobody waited for any more; they are dropped.
    commands, retries : int
        Commands given, and times one had to be sent again.
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
    resent: int = 0
    states_lost: int = 0
    late_answers: int = 0
    commands: int = 0
    retries: int = 0
    queue_dropped: int = 0
    reconnects: int = 0

    def as_dict(self) -> dict[str, int]:
        return asdict(self)


class Sequence:
    """Counts one stream by its sequence numbers modulo 2^30; needs 32 bytes however long it runs."""

    def __init__(self) -> None:
        self.counts = Counts()
        self._newest: int | None = None
        self._seen = 0  # bit k: newest - k has come
        self.every = 1
        """The stream sends each n-th number; those between are not missing."""
        self.gap = 0
        """Messages skipped just before the last accepted message."""

    def add(self, number: int) -> bool:
        """Count one message; False if it came before (then it must not be used again)."""
        self.gap = 0
        counts = self.counts
        if self._newest is None:
            self._begin(number)
            return True
        ahead = (number - self._newest + WRAP // 2) % WRAP - WRAP // 2
        if self.every > 1:
            ahead = -(-ahead // self.every)  # in messages; upwards, for the first may stand off the grid
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
        """A stream begins with `number`: those before it are not missing, those from it on are promised."""
        self._begin((number - 1) % WRAP)
        self.counts.received -= 1

    def expect_until(self, number: int) -> None:
        """A stream has ended before `number`: what has not come by now is lost."""
        if self._newest is not None:
            ahead = (number - 1 - self._newest + WRAP // 2) % WRAP - WRAP // 2
            ahead //= self.every
            if ahead > 0:
                self.counts.lost += ahead
                self._newest = (number - 1) % WRAP
                self._seen = self._seen << ahead & ((1 << WINDOW) - 1) if ahead < WINDOW else 0

    def restart(self) -> None:
        """The stream begins anew (a new connection): the next number is no gap."""
        self._newest = None
        self._seen = 0

    def _begin(self, number: int) -> None:
        # What lies before the first number was never promised to us: it counts as seen, not as lost.
        self._newest = number
        self._seen = (1 << WINDOW) - 1
        self.counts.received += 1
