"""Why the thesis finds h better from pressure: displacement beside the map's features, or in their place.

In sample an equation can only gain by a further term. The thesis' R2 of h falls from .824 to .800 with
displacement (E >= 10: .957 to .882), so its equation with displacement leaves features of the map out:
"using Displacement values rather than the Tactile Map". Which ones is lost. With one linear term each, that
is what comes out where displacement takes the place of two of the four, but for one pair.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from palpate.learn.table import (
    DISPLACEMENT,
    HARD_FROM,
    NAMES,
    PRESSURE,
    coordinates,
    r_squared,
    target_values,
)

CHOICES = (PRESSURE, ("Amp", "Stdev", *DISPLACEMENT), (*PRESSURE, *DISPLACEMENT))
"""Pressure; displacement in the place of Base and Curvature; displacement beside all of the map."""

THESIS = ((0.824, 0.957), (0.800, 0.882), (None, None))
"""The thesis' R2 of h, of all runs and of E >= 10, where `CHOICES` correspond to it."""


def linear_r2(table: pd.DataFrame, features: Sequence[str], rows: NDArray[np.bool_]) -> float:
    """In-sample R2 of h, of `rows` (n) of `table`, by one linear term for each of `features`."""
    y = target_values(table)["h"].to_numpy()[rows]
    X = np.column_stack([np.ones(len(y)), coordinates(table)[list(features)].to_numpy()[rows]])
    return r_squared(y, X @ np.linalg.lstsq(X, y, rcond=None)[0])


def depth_choices(table: pd.DataFrame) -> list[tuple[str, float, float]]:
    """For each of `CHOICES` its features in words, and R2 of h: all runs, those with E >= 10."""
    return [(", ".join(NAMES[f] for f in features), *_both(table, features)) for features in CHOICES]


def two_kept(table: pd.DataFrame) -> list[tuple[str, float, float]]:
    """The two displacements with each two of the map's four features: the two kept, and R2 as above."""
    pairs = combinations(PRESSURE, 2)
    return [(", ".join(NAMES[f] for f in kept), *_both(table, (*kept, *DISPLACEMENT))) for kept in pairs]


def _both(table: pd.DataFrame, features: Sequence[str]) -> tuple[float, float]:
    every, hard = np.ones(len(table), bool), (table["E_ratio"] >= HARD_FROM).to_numpy()
    return linear_r2(table, features, every), linear_r2(table, features, hard)
