"""Intervals with stated coverage: normalised split-conformal prediction.

A residual's expected size sigma is log-linear in the features and in the predictions; the quantile of
|residual| / sigma over unseen lumps, taken separately for those predicted soft and hard, widens it to the
stated coverage (Papadopoulos and others 2002; Lei and others 2018; with residuals from
cross-validation beside those of calibration lumps, Vovk 2015). Constant widths cover some groups of lumps
far too seldom. Sigma is bent for their sake (`evening`); what remains is met by a quantile somewhat above the
stated one: as far above as the worst group of calibration lumps needs, within 2 % of the stated coverage.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.learn.evening import evened
from palpate.learn.ridge import all_terms, fit_ridge
from palpate.model_export.integers.reference import monomials

LEVEL = 0.9
"""Coverage of the intervals, also those of the thesis' equations; probe and page take it from the model."""

CROSS_FOLDS = 8
"""So many that a model fitted without one fold is nearly as good as one fitted to all."""

Fit = Callable[[Floats, Floats, NDArray[np.int64]], Callable[[Floats], Floats]]

WORST_GROUP = LEVEL - 0.005
"""Share of each group of calibration lumps that the intervals should cover."""

MOST = LEVEL + 0.0175
"""The quantile is not taken above this for the sake of a group."""

FEWEST = 50
"""Strokes of which a part of them gets a quantile of its own."""

_STRENGTHS = 10.0 ** np.arange(-4.0, 1.0, 0.5)
_SMALLEST = 1e-6
_SMALLEST_SHARE = 0.1
"""Residuals below this quantile count as that quantile: the logarithm of a near-hit tells nothing."""


@dataclass(frozen=True)
class Widths:
    """ln sigma = coefficients . (monomials of z, predictions); half-width = quantile[class] sigma.

    Attributes
    ----------
    terms : monomials of the standardised features
    coefficients : (terms + outputs, outputs)
    quantiles : (outputs, 2)
        For lumps predicted soft, and predicted hard.
    level : float
    """

    terms: tuple[tuple[int, ...], ...]
    coefficients: Floats
    quantiles: Floats
    level: float

    def sigma(self, z: Floats, y: Floats) -> Floats:
        """Expected size of the residual, (n, outputs), from standardised z (n, features) and predicted y."""
        return np.exp(np.hstack([monomials(z, self.terms), y]) @ self.coefficients)

    def half(self, z: Floats, y: Floats, hard: NDArray[np.bool_]) -> Floats:
        """Half-widths on the link scale, (n, outputs); z, y as for `sigma`, hard (n): as predicted."""
        return self.sigma(z, y) * self.quantiles[:, hard.astype(int)].T


def out_of_fold(
    z: Floats, Y: Floats, groups: NDArray[np.int64], fit: Fit, folds: int = CROSS_FOLDS
) -> Floats:
    """Out-of-fold predictions (n, outputs), whole lumps left out.

    z (n, features), Y (n, outputs), groups (n): which lump; `fit` takes these three and gives a predictor.
    """
    out = np.empty_like(Y)
    fold = np.unique(groups, return_inverse=True)[1] % folds
    for k in range(folds):
        rest = fold != k
        out[~rest] = fit(z[rest], Y[rest], groups[rest])(z[~rest])
    return out


def fit_sigma(
    z: Floats, predicted: Floats, residual: Floats, groups: NDArray[np.int64], degree: int = 1
) -> tuple[tuple[tuple[int, ...], ...], Floats]:
    """Log-linear size of the residuals: monomial terms, and coefficients (terms + outputs, outputs).

    z (n, features), predicted and residual (n, outputs), link scale; groups (n): which lump.
    """
    terms = all_terms(z.shape[1], degree)
    size = np.abs(residual)
    # of few lumps many may be met exactly, at the clipped end of a range
    least = np.maximum(np.quantile(size, _SMALLEST_SHARE, axis=0), _SMALLEST)
    logs = np.log(np.maximum(size, least))
    A = np.hstack([monomials(z, terms), predicted])
    centre, scale = predicted.mean(0), predicted.std(0)
    A[:, len(terms) :] = (predicted - centre) / scale
    degrees = [len(t) for t in terms] + [1] * predicted.shape[1]
    B = fit_ridge(A, logs, degrees, groups, _STRENGTHS).coefficients
    # Back to the predictions as they are, which is what the probe has.
    tail = B[len(terms) :] / scale[:, None]
    B[0] -= centre @ tail
    B[len(terms) :] = tail
    return terms, B


def conformal_quantile(score: Floats, level: float) -> float:
    """The ceil(level (n + 1))-th smallest score: covers a fresh one with probability `level` at least."""
    n = len(score)
    if n == 0:
        return 0.0
    return float(np.sort(score)[min(n, int(np.ceil(level * (n + 1)))) - 1])


def quantile_of_part(score: Floats, part: NDArray[np.bool_], level: float) -> float:
    """`conformal_quantile` of some of the scores, both (n,); of all where these are too few."""
    return conformal_quantile(score[part] if part.sum() >= FEWEST else score, level)


def calibrate(
    terms: tuple[tuple[int, ...], ...],
    coefficients: Floats,
    z: Floats,
    predicted: Floats,
    truth: Floats,
    hard: NDArray[np.bool_],
    level: float = LEVEL,
    groups: Sequence[NDArray[np.bool_]] = (),
    together: Sequence[Sequence[int]] = (),
) -> Widths:
    """Quantiles from out-of-fold strokes, separately for lumps predicted soft and hard.

    `groups` are parts of these strokes: sigma is evened out for them, and the quantiles rise until each is
    covered to `WORST_GROUP`, to the quantile of `MOST` at most. `together`: see `evening.evened`.
    """
    coefficients = evened(terms, coefficients, z, predicted, truth, groups, level, together)
    unit = Widths(terms, coefficients, np.ones((truth.shape[1], 2)), level)
    score = np.abs(truth - predicted) / unit.sigma(z, predicted)
    sides = hard.astype(int)
    quantiles = []
    for of_output in score.T:
        for asked in (level, *np.arange(level + 0.0025, MOST + 1e-9, 0.0025)):
            pair = np.array([conformal_quantile(of_output[sides == side], float(asked)) for side in (0, 1)])
            inside = of_output <= pair[sides]
            if all(inside[group].mean() >= WORST_GROUP for group in groups if group.any()):
                break
        quantiles.append(pair)
    return Widths(terms, coefficients, np.array(quantiles), level)
