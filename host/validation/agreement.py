"""Agreement of a model's answers with the truth, output by output.

Errors are those of the logarithm, but for E^-2/3, which has a scale of its own: a bias of .05 is 5 %. Strokes
over one lump are no independent witnesses, so every confidence interval comes from resampling whole lumps
(cluster bootstrap). Limits of agreement: Bland and Altman 1986, for repeated strokes 2007.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from statsmodels.stats.proportion import proportion_confint

from palpate.dataset.answers import OUTPUTS, Answers
from palpate.features.map_features import Floats
from palpate.regression.table import r_squared

RESAMPLES = 999
CONFIDENCE = 0.95
Z = float(stats.norm.ppf(0.5 + CONFIDENCE / 2))
FEWEST = 3
"""Lumps, under which no confidence interval is given."""

ABSOLUTE = frozenset({"E_inv23"})
"""Outputs whose error is a difference and not a ratio."""


@dataclass(frozen=True)
class Estimated:
    """A number with its 95 % confidence interval; None where there are too few lumps for one."""

    value: float
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class Agreement:
    """One output against the truth.

    Attributes
    ----------
    name : str
    strokes, lumps : int
        Found, and with a truth.
    bias : Estimated
        Mean error: of the logarithm, or of E^-2/3 itself.
    limits : (Estimated, Estimated)
        Between which 95 % of the errors of single strokes lie.
    r2 : Estimated
    median_error : Estimated
        Of the absolute relative error; for E^-2/3 of the absolute one.
    coverage : Estimated
        Share of the truths inside their intervals.
    sd_lump, sd_stroke : float
        Standard deviations of the error: from lump to lump, and from stroke to stroke of a lump.
    errors, means : (strokes,)
        Of each stroke: its error; the middle between truth and estimate, in the output's unit.
    """

    name: str
    strokes: int
    lumps: int
    bias: Estimated
    limits: tuple[Estimated, Estimated]
    r2: Estimated
    median_error: Estimated
    coverage: Estimated
    sd_lump: float
    sd_stroke: float
    errors: Floats
    means: Floats

    @property
    def absolute(self) -> bool:
        """Whether errors are differences."""
        return self.name in ABSOLUTE


def errors_of(name: str, value: Floats, truth: Floats) -> Floats:
    """Errors as they are counted here: ln(value / truth), for E^-2/3 value - truth."""
    if name in ABSOLUTE:
        return value - truth
    return np.log(np.maximum(value, 1e-9) / truth)


def agreement(answers: Answers, name: str, seed: int = 1) -> Agreement | None:
    """One output's agreement with the truth, over the strokes in which a lump was found.

    Parameters
    ----------
    answers : Answers
    name : str
        Of `dataset.answers.OUTPUTS`.
    seed : int
        Of the resampling.

    Returns
    -------
    Agreement, or None where the data set has no truth of it.
    """
    j = OUTPUTS.index(name)
    used = answers.lump & ~np.isnan(answers.truth[:, j])
    if not used.any():
        return None
    value, truth = answers.value[used, j], answers.truth[used, j]
    inside, group = answers.covered[used, j], answers.group[used]
    error = errors_of(name, value, truth)
    relative = np.abs(error) if name in ABSOLUTE else np.abs(value / truth - 1)
    resampled = partial(by_lump, group, seed=seed)
    between, within = spread(error, group)
    low, high = (resampled(partial(_limit_of, error, group, side)) for side in (-1, 1))
    return Agreement(
        name,
        int(used.sum()),
        len(np.unique(group)),
        resampled(lambda k: float(error[k].mean())),
        (low, high),
        resampled(lambda k: _r2(truth[k], value[k])),
        resampled(lambda k: float(np.median(relative[k]))),
        _share(inside, len(np.unique(group)), resampled),
        between,
        within,
        error,
        (value + truth) / 2 if name in ABSOLUTE else np.sqrt(np.maximum(value, 1e-9) * truth),
    )


def _share(inside: Floats, lumps: int, resampled: Callable[..., Estimated]) -> Estimated:
    """Resampling what is always the same says nothing: there Wilson's interval, of as many as lumps."""
    if 0 < inside.mean() < 1 or lumps < FEWEST:
        return resampled(lambda k: float(inside[k].mean()))
    low, high = proportion_confint(inside.mean() * lumps, lumps, alpha=1 - CONFIDENCE, method="wilson")
    return Estimated(float(inside.mean()), float(low), float(high))


def _r2(truth: Floats, value: Floats) -> float:
    return r_squared(truth, value) if np.ptp(truth) > 0 else float("nan")


def spread(error: Floats, group: NDArray[np.int64]) -> tuple[float, float]:
    """Standard deviations of the error from lump to lump, and within one, by the analysis of variance.

    Parameters
    ----------
    error, group : (n,)
    """
    number, count = (
        np.unique(group, return_inverse=True)[1],
        np.bincount(np.unique(group, return_inverse=True)[1]),
    )
    mean = np.bincount(number, error) / count
    lumps, n = len(count), len(error)
    if lumps < 2:
        return 0.0, float(error.std(ddof=1)) if n > 1 else 0.0
    if n == lumps:  # a single stroke over each: the two cannot be told apart
        return float(error.std(ddof=1)), 0.0
    within = float(((error - mean[number]) ** 2).sum() / (n - lumps))
    among = float((count * (mean - error.mean()) ** 2).sum() / (lumps - 1))
    usual = (n - (count**2).sum() / n) / (lumps - 1)
    return float(np.sqrt(max(among - within, 0.0) / usual)), float(np.sqrt(within))


def limit(error: Floats, group: NDArray[np.int64], side: int) -> float:
    """The lower (-1) or upper (1) limit of agreement of single strokes."""
    between, within = spread(error, group)
    return float(error.mean() + side * Z * np.hypot(between, within))


def _limit_of(error: Floats, group: NDArray[np.int64], side: int, rows: NDArray[np.int64]) -> float:
    return limit(error[rows], group[rows], side)


def by_lump(
    group: NDArray[np.int64], statistic: Callable[[NDArray[np.int64]], float], seed: int = 1
) -> Estimated:
    """A statistic of strokes with its 95 % interval by resampling whole lumps.

    Parameters
    ----------
    group : (n,)
        Which lump each stroke is over.
    statistic : callable
        Of the numbers of strokes, some of them several times.
    """
    rows = [np.flatnonzero(group == lump) for lump in np.unique(group)]
    value = statistic(np.concatenate(rows))
    if len(rows) < FEWEST:
        return Estimated(value)

    def of(lumps: Any) -> float:
        return statistic(np.concatenate([rows[int(k)] for k in lumps]))

    found = stats.bootstrap(
        (np.arange(len(rows)),),
        of,
        n_resamples=RESAMPLES,
        vectorized=False,
        method="percentile",
        confidence_level=CONFIDENCE,
        random_state=np.random.default_rng(seed),
    ).confidence_interval
    if not np.isfinite([found.low, found.high]).all():
        return Estimated(value)
    return Estimated(value, float(found.low), float(found.high))
