"""Intervals that hold what they say on lumps that were left out: one factor on an output's widths.

Strokes over one lump are no independent witnesses: n strokes are worth n / (1 + (m - 1) rho), m strokes a
lump whose scores correlate by rho (Kish 1965). Split-conformal prediction takes the quantile for so many,
and one unseen, from the left-out strokes; each lump has the same weight. To count lumps alone is the safe
side of it (hierarchical conformal prediction, Lee, Barber and Willett 2023): with 20 lumps it held 94 %
where 90 were meant. With too few for any quantile the scores' mean square and Student's t stand for it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from palpate.dataset.agreement import spread
from palpate.features.map_features import Floats


def factor(score: Floats, group: NDArray[np.int64], level: float) -> float:
    """By how much the half-widths have to be multiplied to hold `level` of fresh lumps' truths.

    Parameters
    ----------
    score : (n,)
        |residual| / half-width of left-out strokes.
    group : (n,)
        Which lump each is over.
    level : float
    """
    lumps, number, count = np.unique(group, return_inverse=True, return_counts=True)
    worth = witnesses(score, group)
    if worth < level / (1 - level):  # even the largest score would hold less
        square = float(np.mean(np.bincount(number, score**2) / count))
        return float(stats.t.ppf(0.5 + level / 2, worth)) * square**0.5
    order = np.argsort(score)
    weight = (1 / count[number] / len(lumps))[order]
    reached = np.cumsum(weight) >= level * (worth + 1) / worth - 1e-9
    return float(score[order][int(np.argmax(reached))])


def witnesses(score: Floats, group: NDArray[np.int64]) -> float:
    """How many independent strokes these are worth: from as many as there are lumps to all of them."""
    _, count = np.unique(group, return_counts=True)
    strokes = len(score)
    among, within = spread(score, group)
    rho = among**2 / (among**2 + within**2) if within else 1.0
    return strokes / (1 + (float((count**2).sum()) / strokes - 1) * rho)
