"""Tables that users bring, as numpy; boxes and features made of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.space import Array, Feature

WIDER = 0.1
"""Of a feature's range in the data: what the box is wider on each side, but not across zero."""

Box = Sequence[tuple[float, float]] | Mapping[str, tuple[float, float]] | None
Steps = Sequence[float | None] | Mapping[str, float] | None


def table(X: Any, what: str = "X") -> tuple[Array, list[str] | None]:
    """A table's numbers and, if it has any, its columns' names."""
    columns = getattr(X, "columns", None)
    names = None if columns is None else [str(c) for c in columns]
    rows = numbers(X, f"{what}'s entries")
    if rows.ndim == 1:
        rows = rows[:, None]
    if rows.ndim != 2 or not len(rows):
        raise CompileError(f"{what} must be a table with rows and columns, not of shape {rows.shape}")
    if not np.isfinite(rows).all():
        row, column = np.argwhere(~np.isfinite(rows))[0]
        name = names[column] if names else f"column {column}"
        raise CompileError(
            f"{what} has no finite {name} in row {row}; a device's sensors give no NaN: drop it"
        )
    return rows, names


def features(X: Array, names: Sequence[str], box: Box = None, steps: Steps = None) -> list[Feature]:
    """The features of data: their boxes those of the data, a little wider, where none are given."""
    if len(set(names)) < len(names):
        raise CompileError(f"two features have one name: {', '.join(names)}")
    _known(box, names, "box")
    _known(steps, names, "steps")
    found = []
    for i, name in enumerate(names):
        column = X[:, i]
        own = given(box, i, name)
        lo, hi = ends(own, name) if own is not None else _around(column)
        step = given(steps, i, name)
        if own is None and lo == hi:  # constant: it cannot matter, and `used` says so if it does
            lo, hi = lo - max(abs(lo), 1.0), hi + max(abs(hi), 1.0)
        found.append(Feature.over(name, lo, hi, bool((column == np.round(column)).all()), step))
    return found


def ends(given: Any, name: str) -> tuple[float, float]:
    """The two ends of a feature's box."""
    try:
        lo, hi = (float(end) for end in given)
    except (TypeError, ValueError):
        raise CompileError(f"the box of {name} must be two numbers, not {given!r}") from None
    return lo, hi


def numbers(values: Any, what: str) -> Array:
    """An array of numbers, whatever its shape."""
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise CompileError(f"{what} must be numbers") from None


def _around(column: Array) -> tuple[float, float]:
    lo, hi = float(column.min()), float(column.max())
    more = WIDER * (hi - lo)
    if np.all(column == np.round(column)):
        more = float(np.ceil(more))
    below, above = lo - more, hi + more
    return max(below, 0.0) if lo >= 0 else below, min(above, 0.0) if hi <= 0 else above


def _known(of: Any, names: Sequence[str], what: str) -> None:
    if isinstance(of, Mapping):
        for name in of:
            if name not in names:
                raise CompileError(f"{what} names {name!r}, which is none of the features {', '.join(names)}")
    elif of is not None and len(of) != len(names):
        raise CompileError(f"{what} has {len(of)} entries for {len(names)} features")


def given(of: Any, i: int, name: str) -> Any:
    """The entry of a list, or of a mapping by name, for feature i; None where there is none."""
    if of is None:
        return None
    return of.get(name) if isinstance(of, Mapping) else of[i]


def tolerances(given: Any, outputs: int, precise: str) -> list[float]:
    """`within`, one an output; `precise` is looked at as well."""
    if precise not in ("box", "data"):
        raise CompileError(f'precise is "box" or "data", not {precise!r}')
    if given is None:
        return []
    found = np.ravel(numbers(given, "within")).tolist()
    if len(found) != outputs or not all(np.isfinite(w) and w > 0 for w in found):
        raise CompileError(f"within must be {outputs} positive numbers, one an output, not {given!r}")
    return found


def named(given: Sequence[str] | None, n: int, what: str) -> list[str]:
    """n names or units, as given, or made up."""
    if given is None:
        return [] if not n else [f"{what}{k}" if n > 1 else what for k in range(n)]
    if isinstance(given, str) or len(given) != n:
        raise CompileError(f"there are {n} of {what}, and {given!r} for them")
    return [str(g) for g in given]
