"""Proof that no intermediate of an evaluation leaves +-2^30, whatever the features.

The proof runs the evaluator's own functions (`firmware_py.evaluator.compute`, the same code objects)
on intervals instead of integers: every sum, product and shift is taken of whole ranges and must stay
inside. Only the three functions that branch on data are exchanged: `clip` and `pick` for their
hulls, `exp` for itself run piece by piece over ranges on which it does not branch.
"""

from __future__ import annotations

import types
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from firmware_py import evaluator, fixed, polynomial, scales, stage
from palpate.model_export.errors import ProofError

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
        lo, hi = _ends(other)
        return Interval(self.lo + lo, self.hi + hi)

    __radd__ = __add__

    def __neg__(self) -> Interval:
        return Interval(-self.hi, -self.lo)

    def __sub__(self, other: Any) -> Interval:
        lo, hi = _ends(other)
        return Interval(self.lo - hi, self.hi - lo)

    def __rsub__(self, other: Any) -> Interval:
        lo, hi = _ends(other)
        return Interval(lo - self.hi, hi - self.lo)

    def __mul__(self, other: Any) -> Interval:
        lo, hi = _ends(other)
        products = (self.lo * lo, self.lo * hi, self.hi * lo, self.hi * hi)
        return Interval(min(products), max(products))

    __rmul__ = __mul__

    def __floordiv__(self, other: int) -> Interval:
        lo, hi = _ends(other)
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
        lo, hi = _ends(other)
        if self.hi < lo or self.lo >= hi:
            return self.hi < lo
        raise Ambiguous

    def __ge__(self, other: Any) -> bool:
        return not self < other

    def __gt__(self, other: Any) -> bool:
        lo, hi = _ends(other)
        if self.lo > hi or self.hi <= lo:
            return self.lo > hi
        raise Ambiguous

    def __le__(self, other: Any) -> bool:
        return not self > other


def _ends(value: Any) -> tuple[int, int]:
    if isinstance(value, Interval):
        return value.lo, value.hi
    return value, value


def _one(value: Any) -> int:
    lo, hi = _ends(value)
    if lo != hi:
        raise Ambiguous
    return lo


def hull(*values: Any) -> Interval:
    """The least interval that holds all the values."""
    ends = [_ends(v) for v in values]
    return Interval(min(lo for lo, _ in ends), max(hi for _, hi in ends))


def _clip(v: Any, lo: int, hi: int) -> Interval:
    a, b = _ends(v)
    return Interval(min(max(a, lo), hi), min(max(b, lo), hi))


def _pick(v: Any, limit: int, below: Any, above: Any) -> Interval:
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


def _exp(v: Any, s: int) -> Interval:
    """`scales.exp` over an interval; what it looks up changes at the multiples of its step."""
    lo, hi = _ends(v)
    if (lo, hi, s) not in _exp_known:
        edges = [EXP_STEP * k for k in range(lo // EXP_STEP, hi // EXP_STEP + 1)]
        result = over_pieces(scales.exp, Interval(lo, hi), edges, s)
        _exp_known[lo, hi, s] = (result.lo, result.hi)
    return Interval(*_exp_known[lo, hi, s])


@dataclass(frozen=True)
class Proof:
    """The largest magnitude that any intermediate can reach, and over how many operations."""

    largest: int
    operations: int

    @property
    def headroom_bits(self) -> float:
        """How many bits remain below 2^30."""
        from math import log2

        return 30 - log2(max(self.largest, 1))

    def __str__(self) -> str:
        return (
            f"proved over {self.operations} interval operations: no intermediate exceeds "
            f"{self.largest} ({self.headroom_bits:.1f} bits below 2^30)"
        )


def _on_intervals() -> dict[str, Any]:
    """The evaluator's functions, with those that branch on data exchanged."""
    namespace = vars(scales) | vars(polynomial) | vars(evaluator) | vars(stage)
    namespace.update(clip=_clip, pick=_pick, exp=_exp)
    for name, item in namespace.items():
        if isinstance(item, types.FunctionType) and name not in ("clip", "pick", "exp"):
            namespace[name] = types.FunctionType(item.__code__, namespace, name)
    return namespace


def prove_first(first: stage.Stage) -> Proof:
    """The same for a first stage, whose values are features like any other to the second, or for checks."""
    namespace = _on_intervals()
    if any(abs(v) > 1 << 15 for v in (*first.c, *first.d)):
        raise ProofError("a coefficient of the first stage, or of a check, does not fit its word")
    for part in ("feats", "own", "rows", "ends", "head"):
        if any(not -LIMIT <= v < LIMIT for v in getattr(first, part)):
            raise ProofError(f"an entry of the first stage's table {part} is beyond 2^30")
    Interval.operations = 0
    Interval.largest = 0
    n = first.head[evaluator.N_FEATURES]
    x: list[Any] = [Interval(-fixed.LIMIT, fixed.LIMIT)] * (first.feature_count + stage.MOST)
    bits: list[list[Any]] = [[0] * (n + evaluator.OUTPUTS) for _ in range(2)]
    namespace["estimates"](
        x, list(first.ids), list(first.feats), first.steps, list(first.c), list(first.d), list(first.own),
        list(first.rows), list(first.ends), list(first.head), [0] * n, *bits, [0] * evaluator.WORK,
        first.feature_count, first.count,
    )  # fmt: skip
    return Proof(Interval.largest, Interval.operations)


def prove(tables: evaluator.Tables) -> Proof:
    """Prove a compiled model, or raise ProofError.

    The features are taken to be anything a Q24 feature can be (+-(2^29 - 1)); the model's own clip
    box narrows them, so the proof covers its declared domain and everything outside it.
    """
    namespace = _on_intervals()
    words = {"b": 7, "h": 15, "i": 31}
    for part in ("c", "d"):
        table = getattr(tables, part)
        if any(abs(v) > 1 << words[table.typecode] for v in table):
            raise ProofError(f"a coefficient does not fit the word of table {part}")
    for part in ("feats", "own", "rows", "outs", "limits", "head"):
        if any(not -LIMIT <= v < LIMIT for v in getattr(tables, part)):
            raise ProofError(f"an entry of table {part} is beyond 2^30")
    Interval.operations = 0
    Interval.largest = 0
    _exp_known.clear()
    n = tables.head[evaluator.N_FEATURES]
    ids = list(tables.ids)
    feature = Interval(-fixed.LIMIT, fixed.LIMIT)
    x: list[Any] = [feature] * (max(ids) + 1)
    u: list[Any] = [0] * n
    first_bits: list[Any] = [0] * (n + evaluator.OUTPUTS)
    high = first_bits.copy()
    work: list[Any] = [0] * evaluator.WORK
    out: list[Any] = [0] * evaluator.OUT_SIZE
    namespace["compute"](
        x, ids, list(tables.feats), tables.steps, list(tables.c), list(tables.d), list(tables.own),
        list(tables.rows), list(tables.outs), list(tables.head), u, first_bits, high, work, out,
    )  # fmt: skip
    return Proof(Interval.largest, Interval.operations)
