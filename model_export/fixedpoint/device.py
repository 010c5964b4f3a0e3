"""Functions that a written program takes along, once as the device has them and once for whole columns.

`lookup` is written out as it stands here; `exp` is the firmware's `scales.exp`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from firmware_py import scales
from palpate.fixedpoint.intervals import Interval, hull

ROW = 5
"""Numbers of a piece in a table: its shift, then four coefficients."""


def lookup(x, first, rows):  # type: ignore[no-untyped-def]
    """A function of x by its pieces: cubics from each of `first` on, their numbers in `rows`."""
    i = 0
    k = len(first)
    while k - i > 1:
        h = (i + k) >> 1
        if x < first[h]:
            k = h
        else:
            i = h
    x -= first[i]
    i *= 5
    k = rows[i]
    x = x << k if k >= 0 else x >> -k
    a = x >> 14
    x &= 16383
    v = rows[i + 4]
    for k in (3, 2, 1):
        h = v >> 14
        v = rows[i + k] + a * h + ((a * (v & 16383) + x * h) >> 14)
    return v


@dataclass(frozen=True)
class Table:
    """Cubics by pieces: piece k begins at first[k]; the last ends at `last`.

    Attributes
    ----------
    first : tuple of int
        Ascending; what is below the first belongs to it.
    rows : tuple of int
        Five a piece: what shifts x less the piece's beginning to 1 in Q28; coefficients, constant first.
    last : int
    """

    first: tuple[int, ...]
    rows: tuple[int, ...]
    last: int

    @cached_property
    def _columns(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array(self.first), np.array(self.rows).reshape(-1, ROW)

    def of(self, x: np.ndarray) -> np.ndarray:
        """`lookup` of a column."""
        first, rows = self._columns
        i = np.maximum(np.searchsorted(first, x, side="right") - 1, 0)
        shift = rows[i, 0]
        t = (x - first[i]) * (1 << np.maximum(shift, 0)) >> np.maximum(-shift, 0)
        a, b = t >> 14, t & 16383
        v = rows[i, 4]
        for k in (3, 2, 1):
            h = v >> 14
            v = rows[i, k] + a * h + ((a * (v & 16383) + b * h) >> 14)
        return v

    @cached_property
    def _known(self) -> dict[tuple[int, int], tuple[int, int, int]]:
        return {}

    def over(self, x: Interval) -> Interval:
        """`lookup` of a range."""
        if (x.lo, x.hi) not in self._known:
            before, Interval.largest = Interval.largest, 0
            found = self._over(x)
            self._known[x.lo, x.hi] = (found.lo, found.hi, Interval.largest)
            Interval.largest = before
        lo, hi, largest = self._known[x.lo, x.hi]
        Interval.largest = max(Interval.largest, largest)
        return Interval(lo, hi)

    def _over(self, x: Interval) -> Interval:
        found = []
        ends = [*self.first[1:], max(self.last, x.hi) + 1]
        for k, (begin, end) in enumerate(zip(self.first, ends)):
            lo, hi = max(x.lo, begin if k else x.lo), min(x.hi, end - 1)
            if lo <= hi:
                shift, *c = self.rows[ROW * k : ROW * k + ROW]
                t = (Interval(lo, hi) - begin) >> max(-shift, 0)
                t = t * (1 << max(shift, 0))
                v: Interval | int = c[3]
                for own in (c[2], c[1], c[0]):
                    v = hull(v)
                    h = v >> 14
                    v = (t >> 14) * h + (((t >> 14) * (v & 16383) + (t & 16383) * h) >> 14) + own
                found.append(v)
        return hull(*found)


_POWERS = np.array(scales.POWERS)


def exp_of(v: np.ndarray, s: int) -> np.ndarray:
    """`scales.exp` of a column."""
    k = v // 181704
    w = v - (k * 181704 + (k * 3 >> 3))
    m = _POWERS[k & 63]
    h = w >> 3
    w = w + (h * h >> 19)
    m = m + ((m >> 10) * (w >> 3) >> 11)
    down = s - (k >> 6)
    right = np.clip(down, 1, 40)
    small = np.where(down < 31, (m + (1 << (right - 1))) >> right, 0)
    large = np.where(down > -5, m << np.clip(-down, 0, 4), 0x3FFFFFFF)
    return np.where(down > 0, small, large)
