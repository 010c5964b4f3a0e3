"""Proof that no intermediate of an evaluation leaves +-2^30, whatever the features.

The proof runs the evaluator's own functions (`firmware_py.evaluator.compute`, the same code objects)
on intervals instead of integers (`palpate.fixedpoint.intervals`).
"""

from __future__ import annotations

import types
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from firmware_py import evaluator, fixed, polynomial, scales, stage
from palpate.fixedpoint import intervals
from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.intervals import LIMIT, Interval, Proof
from palpate.model_export.errors import ProofError


@contextmanager
def told_as_ours() -> Iterator[None]:
    """The general compiler's errors as the exporter's ProofError; also a decorator."""
    try:
        yield
    except CompileError as error:
        raise ProofError(str(error)) from None


def _on_intervals() -> dict[str, Any]:
    """The evaluator's functions, with those that branch on data exchanged."""
    namespace = vars(scales) | vars(polynomial) | vars(evaluator) | vars(stage)
    namespace.update(clip=intervals.clip, pick=intervals.pick, exp=intervals.exp)
    for name, item in namespace.items():
        if isinstance(item, types.FunctionType) and name not in ("clip", "pick", "exp"):
            namespace[name] = types.FunctionType(item.__code__, namespace, name)
    return namespace


@told_as_ours()
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
        list(first.rows), list(first.ends), list(first.head), [0] * n, *bits, [0] * (3 * first.count),
        first.feature_count, first.count,
    )  # fmt: skip
    return Proof(Interval.largest, Interval.operations)


@told_as_ours()
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
