"""Integers known by their range alone: arithmetic on whole ranges, and the proof that it gives.

A function that has no branch on data runs on `Interval` as it runs on integers; every sum, product and shift
must stay inside +-2^30. The few functions that branch are exchanged: `clip` and `pick` for their hulls, `exp`
for itself run piece by piece over ranges on which it does not branch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import log2
from typing import Any

from firmware_py import scales
from palpate.fixedpoint.errors import ProofError

LIMIT = 1 << 30
EXP_STEP = 181704  # of scales.exp's table


class Ambiguous(Exception):
    """A comparison or an index whose answer differs within the interval."""


class Interval:
    """All integers from lo to hi; arithmetic gives an interval that holds every possible result."""

    __slots__ = ("hi", "lo")
    operations = 0
    largest = 0

    def __init__(self, lo: int, hi: int) -> None:
        if lo < -LIMIT or hi >= LIMIT:
            raise ProofError(f"an intermediate may reach {max(-lo, hi)}, beyond 2^30")
        Interval.operations += 1
        Interval.largest = max(Interval.largest, -lo, hi)
        self.lo = lo
        self.hi = hi

    def __repr__(self) -> str:
        return f"[{self.lo}, {self.hi}]"

    def __add__(self, other: Any) -> Interval:
        lo, hi = ends(other)
        return Interval(self.lo + lo, self.hi + hi)

    __radd__ = __add__

    def __neg__(self) -> Interval:
        return Interval(-self.hi, -self.lo)

    def __sub__(self, other: Any) -> Interval:
        lo, hi = ends(other)
        return Interval(self.lo - hi, self.hi - lo)

    def __rsub__(self, other: Any) -> Interval:
        lo, hi = ends(other)
        return Interval(lo - self.hi, hi - self.lo)

    def __mul__(self, other: Any) -> Interval:
        lo, hi = ends(other)
        products = (self.lo * lo, self.lo * hi, self.hi * lo, self.hi * hi)
        return Interval(min(products), max(products))

    __rmul__ = __mul__

    def __floordiv__(self, other: int) -> Interval:
        lo, hi = ends(other)
        if lo != hi or lo <= 0:
            raise Ambiguous
        return Interval(self.lo // lo, self.hi // lo)

    def __rshift__(self, other: Any) -> Interval:
        s = _one(other)
        return Interval(self.lo >> s, self.hi >> s)

    def __lshift__(self, other: Any) -> Interval:
        s = _one(other)
        return Interval(self.lo << s, self.hi << s)

    def __rlshift__(self, other: int) -> Interval:
        return Interval(other << _one(self), other << _one(self))

    def __and__(self, mask: int) -> Interval:
        if mask < 0 or mask & (mask + 1):
            raise Ambiguous
        if self.lo & ~mask == self.hi & ~mask:
            return Interval(self.lo & mask, self.hi & mask)
        return Interval(0, mask)

    def __index__(self) -> int:
        return _one(self)

    def __lt__(self, other: Any) -> bool:
        lo, hi = ends(other)
        if self.hi < lo or self.lo >= hi:
            return self.hi < lo
        raise Ambiguous

    def __ge__(self, other: Any) -> bool:
        return not self < other

    def __gt__(self, other: Any) -> bool:
        lo, hi = ends(other)
        if self.lo > hi or self.hi <= lo:
            return self.lo > hi
        raise Ambiguous

    def __le__(self, other: Any) -> bool:
        return not self > other


def ends(value: Any) -> tuple[int, int]:
    """Least and greatest of an interval, or of a number."""
    if isinstance(value, Interval):
        return value.lo, value.hi
    return value, value


def _one(value: Any) -> int:
    lo, hi = ends(value)
    if lo != hi:
        raise Ambiguous
    return lo


def hull(*values: Any) -> Interval:
    """The least interval that holds all the values."""
    all_ends = [ends(v) for v in values]
    return Interval(min(lo for lo, _ in all_ends), max(hi for _, hi in all_ends))


def clip(v: Any, lo: int, hi: int) -> Interval:
    """`scales.clip` of every integer of v."""
    a, b = ends(v)
    return Interval(min(max(a, lo), hi), min(max(b, lo), hi))


def pick(v: Any, limit: int, below: Any, above: Any) -> Interval:
    """`scales.pick`, whichever it may be."""
    return hull(below, above)


def over_pieces(function: Callable[..., Any], v: Interval, edges: list[int], *rest: Any) -> Interval:
    """Hull of `function` over v, cut at the edges, then halved wherever it branches."""
    inside = sorted({e for e in edges if v.lo < e <= v.hi})
    pieces = list(zip([v.lo, *inside], [*(e - 1 for e in inside), v.hi]))
    results = []
    while pieces:
        lo, hi = pieces.pop()
        try:
            results.append(function(Interval(lo, hi), *rest))
        except Ambiguous:
            middle = (lo + hi) // 2
            pieces += [(lo, middle), (middle + 1, hi)]
    return hull(*results)


_exp_known: dict[tuple[int, int, int], tuple[int, int]] = {}


def exp(v: Any, s: int) -> Interval:
    """`scales.exp` over an interval; what it looks up changes at the multiples of its step."""
    lo, hi = ends(v)
    if (lo, hi, s) not in _exp_known:
        edges = [EXP_STEP * k for k in range(lo // EXP_STEP, hi // EXP_STEP + 1)]
        result = over_pieces(scales.exp, Interval(lo, hi), edges, s)
        _exp_known[lo, hi, s] = (result.lo, result.hi)
    return Interval(*_exp_known[lo, hi, s])


@dataclass(frozen=True)
class Proof:
    """The largest magnitude that any intermediate can reach, over how many operations, and where if known."""

    largest: int
    operations: int
    where: str = ""

    @property
    def headroom_bits(self) -> float:
        """How many bits remain below 2^30."""
        return 30 - log2(max(self.largest, 1))

    def __str__(self) -> str:
        return (
            f"proved over {self.operations} interval operations: no intermediate exceeds "
            f"{self.largest} ({self.headroom_bits:.1f} bits below 2^30)"
            + (f", reached in {self.where}" if self.where else "")
        )
