"""Intervals that hold what they say on lumps that were left out: one factor on an output's widths.

From `ENOUGH` lumps on by hierarchical conformal prediction: every left-out lump's strokes share its weight,
and an unseen lump the weight of one more (Lee, Barber and Willett 2023). With fewer the quantile would be
their largest error or beyond it; there the errors' mean square stands for it, with Student's t.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from palpate.features.map_features import Floats

ENOUGH = 20
"""Lumps; with fewer the weight of one more pushes the quantile into the last few strokes: with 9 lumps, 90 %
intervals held 96."""


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
    n = len(lumps)
    if n < ENOUGH:
        square = float(np.mean(np.bincount(number, score**2) / count))
        return float(stats.t.ppf(0.5 + level / 2, n)) * square**0.5
    order = np.argsort(score)
    weight = (1 / count[number] / (n + 1))[order]
    reached = np.cumsum(weight) >= level - 1e-12
    return float(score[order][int(np.argmax(reached))]) if reached.any() else float(score.max())
