"""Faults on a link, from a seed: the same seed corrupts the same bytes.

All probabilities are per byte unless they say otherwise.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Faults:
    """A bad link. `flip`, `lose`, `double`, `swap`: probability that a byte has one bit flipped, is
    lost, comes twice, changes places with the next; `burst`: that a burst begins here, which replaces
    `burst_bytes` bytes by noise; `chatter`: that another program writes a line of text here; `stall`: that
    the link stalls for `stall_s` seconds; `cut`: that the connection is cut here (and may be made again)."""

    flip: float = 0.0
    lose: float = 0.0
    double: float = 0.0
    swap: float = 0.0
    burst: float = 0.0
    burst_bytes: int = 20
    chatter: float = 0.0
    stall: float = 0.0
    stall_s: float = 0.2
    cut: float = 0.0


CHATTER = b"\r\nmodem-manager: AT+GCAP\r\n"


class FaultyLine:
    """One direction of a bad link. `fault_counts` counts what was done, by the name of the fault."""

    def __init__(self, faults: Faults, seed: int) -> None:
        self.faults = faults
        self.fault_counts: dict[str, int] = dict.fromkeys(
            ("flip", "lose", "double", "swap", "burst", "chatter", "stall", "cut"), 0
        )
        self.stall_s = 0.0  # how long the line stalls from here on; whoever waits resets it
        self.cut = False  # the connection is to be cut now; whoever cuts resets it
        self._random = np.random.default_rng(seed)

    def _hits(self, n: int, probability: float, name: str) -> np.ndarray:
        if probability <= 0 or n == 0:
            return np.empty(0, dtype=np.intp)
        hits = np.flatnonzero(self._random.random(n) < probability)
        self.fault_counts[name] += len(hits)
        return hits

    def pass_through(self, data: bytes) -> bytes:
        """What arrives of `data`."""
        f = self.faults
        n = len(data)
        line = np.frombuffer(data, dtype=np.uint8).copy()
        for at in self._hits(n, f.burst, "burst"):
            line[at : at + f.burst_bytes] = self._random.integers(0, 256, len(line[at : at + f.burst_bytes]))
        flips = self._hits(n, f.flip, "flip")
        line[flips] ^= np.uint8(1) << self._random.integers(0, 8, len(flips)).astype(np.uint8)
        for at in self._hits(n - 1, f.swap, "swap"):
            line[[at, at + 1]] = line[[at + 1, at]]
        times = np.ones(n, dtype=np.intp)
        times[self._hits(n, f.double, "double")] = 2
        times[self._hits(n, f.lose, "lose")] = 0
        if len(self._hits(n, f.stall, "stall")):
            self.stall_s = f.stall_s
        if len(self._hits(n, f.cut, "cut")):
            self.cut = True
        talk = self._hits(n, f.chatter, "chatter")
        if not len(talk):
            return np.repeat(line, times).tobytes()
        pieces, before = [], 0
        for at in talk:
            pieces += [np.repeat(line[before:at], times[before:at]).tobytes(), CHATTER]
            before = at
        pieces.append(np.repeat(line[before:], times[before:]).tobytes())
        return b"".join(pieces)
