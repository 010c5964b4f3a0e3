"""How good a model is on unseen strokes: the numbers of one output, and which lumps are found."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.learn.observed import Observed
from palpate.learn.table import r_squared

Mask = NDArray[np.bool_]

_EDGES = {
    "d_mm": (5.0, 10.0, 15.0, 20.0),
    "depth_mm": (0.0, 5.0, 10.0, 15.0, 20.0, 30.0),
    "E": (2.0, 4.0, 10.0, 1000.0),
}
"""Of the map of lumps that are found."""


def share(of: Mask) -> float:
    """Of those that hold; nan of none."""
    return float(of.mean()) if len(of) else float("nan")


def of_output(
    name: str, true: Floats, value: Floats, half: Floats | None, absolute: bool = False
) -> dict[str, float]:
    """R2, median error, coverage and median half-width of one output, (n) each.

    Errors of logarithms are given as shares, unless they are to be `absolute`; half: None where there are no
    intervals.
    """
    error = np.abs(value - true)
    size = float(np.median(error if absolute else np.expm1(error)))
    out = {f"{name}_r2": r_squared(true, value), f"{name}_error": size}
    if half is not None:
        out |= {f"{name}_covered": float((error <= half).mean()), f"{name}_half": float(np.median(half))}
    return out


def found_by(seen: Observed) -> pd.DataFrame:
    """Detectability: share of strokes over lumps in which one is found, by d, depth and E.

    Returns
    -------
    DataFrame
        Columns d_mm, depth_mm, E (each a range), n, found; a row for each that holds strokes.
    """
    of = {
        "d_mm": np.exp(seen.of("ln d")),
        "depth_mm": np.exp(seen.of("ln depth")),
        "E": seen.of("E^-2/3") ** -1.5,
    }
    ranges = {name: pd.cut(of[name], edges, include_lowest=True) for name, edges in _EDGES.items()}
    table = pd.DataFrame(ranges | {"found": seen.found}).groupby(list(_EDGES), observed=True)["found"]
    out = table.agg(n="size", found="mean").reset_index()
    for name, edges in _EDGES.items():
        words = [f"{low:g} to {high:g}" for low, high in itertools.pairwise(edges)]
        out[name] = out[name].cat.rename_categories(words).astype(str)
    return out


def ordered(ranges: Iterable[str]) -> list[str]:
    """Ranges such as "5 to 10", each once, by their lower end."""
    return sorted(set(ranges), key=lambda text: float(text.split()[0]))


def flat(rows: Mapping[str, Any]) -> dict[str, Any]:
    """A mapping with NaN as None, for JSON."""
    return {k: (None if isinstance(v, float) and np.isnan(v) else v) for k, v in rows.items()}
