"""Agreement of a model's answers with the truth, output by output.

Errors are those of the logarithm, but for E^-2/3, which has a scale of its own: a bias of .05 is 5 %. Strokes
over one lump are no independent witnesses, so every confidence interval comes from resampling whole lumps
(cluster bootstrap). Limits of agreement: Bland and Altman 1986, for repeated strokes 2007.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from statsmodels.stats.proportion import proportion_confint

from palpate.dataset.answers import OUTPUTS, JudgedAnswers
from palpate.features.map_features import Floats

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


def agreement(answers: JudgedAnswers, name: str, seed: int = 1) -> Agreement | None:
    """One output's agreement with the truth, over the strokes in which a lump was found.

    Parameters
    ----------
    answers : JudgedAnswers
    name : str
        Of `dataset.answers.OUTPUTS`.
    seed : int
        Of the resampling.

    Returns
    -------
    Agreement, or None where the data set has no truth of it.
    """
    j = OUTPUTS.index(name)
    used = answers.known(name)
    if not used.any():
        return None
    value, truth = answers.value[used, j], answers.truth[used, j]
    inside, group = answers.covered[used, j], answers.group[used]
    error = errors_of(name, value, truth)
    relative = np.abs(error) if name in ABSOLUTE else np.abs(value / truth - 1)
    resampled = partial(by_lump, group, seed=seed)
    between, within = spread(error, group)
    lumps = len(np.unique(group))
    return Agreement(
        name,
        int(used.sum()),
        lumps,
        resampled(partial(_mean, error)),
        (resampled(partial(_limit, error, group, -1)), resampled(partial(_limit, error, group, 1))),
        resampled(partial(_r2, truth, value)),
        resampled(partial(_median, relative)),
        _share(inside, lumps, resampled),
        between,
        within,
        error,
        (value + truth) / 2 if name in ABSOLUTE else np.sqrt(np.maximum(value, 1e-9) * truth),
    )


def _share(inside: Floats, lumps: int, resampled: Callable[..., Estimated]) -> Estimated:
    """Resampling what is always the same says nothing: there Wilson's interval, of as many as lumps."""
    if 0 < inside.mean() < 1 or lumps < FEWEST:
        return resampled(partial(_mean, inside.astype(float)))
    return wilson(inside.mean() * lumps, lumps)


def wilson(hits: float, of: int) -> Estimated:
    """The share of `hits` with Wilson's interval."""
    low, high = proportion_confint(hits, of, alpha=1 - CONFIDENCE, method="wilson")
    return Estimated(float(hits / of), float(low), float(high))


# ---- statistics of strokes that count `times` each, (..., n) -> (...)


def _mean(values: Floats, times: Floats) -> Floats:
    return np.asarray(times @ values / times.sum(-1))


def _median(values: Floats, times: Floats) -> Floats:
    order = np.argsort(values)
    reached, n = np.cumsum(times[..., order], -1), times.sum(-1)[..., None]
    middle = [(reached < half).sum(-1) for half in ((n + 1) // 2, n // 2 + 1)]
    return np.asarray(values[order[middle[0]]] + values[order[middle[1]]]) / 2


def _r2(truth: Floats, value: Floats, times: Floats) -> Floats:
    off = truth - (middle := truth.mean())
    total = times @ off**2 - times.sum(-1) * _mean(off, times) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        found = 1 - times @ (truth - value) ** 2 / total
    return np.where(total > 1e-12 * middle**2, found, np.nan)


def _limit(error: Floats, group: NDArray[np.int64], side: int, times: Floats) -> Floats:
    """The lower (-1) or upper (1) limit of agreement of single strokes."""
    between, within = _spread(error, group, times)
    return np.asarray(_mean(error, times) + side * Z * np.hypot(between, within))


def spread(error: Floats, group: NDArray[np.int64]) -> tuple[float, float]:
    """Standard deviations of the error from lump to lump, and within one, by the analysis of variance.

    Parameters
    ----------
    error, group : (n,)
    """
    between, within = _spread(error, group, np.ones(len(error)))
    return float(between), float(within)


def _spread(error: Floats, group: NDArray[np.int64], times: Floats) -> tuple[Floats, Floats]:
    """The same of strokes that count several times, all strokes of a lump alike."""
    _, first, number, own = np.unique(group, return_index=True, return_inverse=True, return_counts=True)
    mean = np.bincount(number, error) / own
    squares = np.bincount(number, (error - mean[number]) ** 2)
    drawn = times[..., first]
    count, n = drawn * own, times.sum(-1)
    lumps = (drawn > 0).sum(-1)
    middle = _mean(error, times)[..., None]
    whole = (count * (mean - middle) ** 2).sum(-1) + drawn @ squares
    alone = np.sqrt(whole / np.maximum(n - 1, 1))
    inside = drawn @ squares / np.maximum(n - lumps, 1)
    among = (count * (mean - middle) ** 2).sum(-1) / np.maximum(lumps - 1, 1)
    usual = (n - (count**2).sum(-1) / n) / np.maximum(lumps - 1, 1)
    between = np.sqrt(np.maximum(among - inside, 0) / np.where(lumps > 1, usual, 1))
    within = np.sqrt(inside)
    # Over a single lump nothing differs from lump to lump; of single strokes the two cannot be told apart.
    between, within = np.where(lumps < 2, 0, between), np.where(lumps < 2, alone, within)
    single = (n == lumps) & (lumps > 1)
    return np.where(single, alone, between), np.where(single, 0, within)


def by_lump(group: NDArray[np.int64], statistic: Callable[[Floats], Floats], seed: int = 1) -> Estimated:
    """A statistic of strokes with its 95 % interval by resampling whole lumps.

    Parameters
    ----------
    group : (n,)
        Which lump each stroke is over.
    statistic : callable
        Of how often each stroke counts, (..., n) -> (...).
    """
    number = np.unique(group, return_inverse=True)[1]
    lumps = int(number.max()) + 1
    value = float(statistic(np.ones(len(group))))
    if lumps < FEWEST:
        return Estimated(value)

    def of(drawn: Any, axis: int) -> Floats:
        times = np.apply_along_axis(np.bincount, axis, drawn.astype(int), minlength=lumps)
        return statistic(times[:, number].astype(float))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", stats.DegenerateDataWarning)  # no interval is given then, see below
        found = stats.bootstrap(
            (np.arange(lumps),),
            of,
            n_resamples=RESAMPLES,
            vectorized=True,
            batch=max(1, 2_000_000 // len(group)),
            method="percentile",
            confidence_level=CONFIDENCE,
            random_state=np.random.default_rng(seed),
        ).confidence_interval
    if not np.isfinite([found.low, found.high]).all():
        return Estimated(value)
    return Estimated(value, float(found.low), float(found.high))
