"""Log-polynomials by ridge regression whose strength is chosen by cross-validation over whole lumps.

Strokes over one lump share a fold: a model scored on a lump it was trained on would look too good.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from palpate.features.map_features import Floats

Term = tuple[int, ...]

DEGREE_PENALTY = (0.0, 1e-2, 1.0, 4.0)
"""Relative ridge on terms of degree 0 to 3: higher degrees are penalised more."""

STRENGTHS = 10.0 ** np.arange(-8.0, -0.4, 0.5)
FOLDS = 4


def all_terms(features: int, degree: int) -> tuple[Term, ...]:
    """Every monomial up to `degree`, as sorted tuples of feature numbers; () is the constant."""
    return tuple(t for k in range(degree + 1) for t in combinations_with_replacement(range(features), k))


@dataclass(frozen=True)
class RidgeFit:
    """Coefficients (terms, outputs), the strength chosen for each output, and its cross-validated error.

    `error` is the mean squared error over left-out lumps, one per output.
    """

    coefficients: Floats
    strength: Floats
    error: Floats


def fit_ridge(
    A: Floats,
    Y: Floats,
    degrees: Sequence[int],
    groups: NDArray[np.int64],
    strengths: Floats = STRENGTHS,
) -> RidgeFit:
    """Ridge regression of Y (n, outputs) on A (n, terms), one strength for each output.

    Parameters
    ----------
    A, Y : arrays
    degrees : sequence of int
        Degree of each term, for its penalty.
    groups : int array (n)
        Which lump each row belongs to.
    strengths : array
        Candidates, relative to the number of rows.
    """
    n = len(A)
    penalty = np.array([max(DEGREE_PENALTY[k], 1e-9) for k in degrees])
    A = A / np.sqrt(penalty)
    G, H = A.T @ A, A.T @ Y
    error = np.zeros((len(strengths), Y.shape[1]))
    # A lump's fold must not depend on the order of the rows.
    fold = np.unique(groups, return_inverse=True)[1] % FOLDS
    for k in range(FOLDS):
        out = fold == k
        a, y = A[out], Y[out]
        values, vectors = np.linalg.eigh(G - a.T @ a)
        values = np.maximum(values, 0)
        weights, observed = vectors.T @ (H - a.T @ y), a @ vectors
        for j, strength in enumerate(strengths):
            left = y - observed @ (weights / (values + strength * n)[:, None])
            error[j] += (left**2).sum(axis=0)
    best = error.argmin(axis=0)
    values, vectors = np.linalg.eigh(G)
    values, weights = np.maximum(values, 0), vectors.T @ H
    B = np.column_stack([vectors @ (weights[:, k] / (values + strengths[j] * n)) for k, j in enumerate(best)])
    return RidgeFit(B / np.sqrt(penalty)[:, None], strengths[best], error[best, np.arange(Y.shape[1])] / n)


def importance(A: Floats, degrees: Sequence[int], fit: RidgeFit) -> Floats:
    """What each term is worth: its squared coefficients over their variances, summed over outputs (Wald).

    Parameters
    ----------
    A, degrees : as `fit_ridge` took them
    fit : RidgeFit

    Returns
    -------
    array (terms)
        About by how much the sum of squared residuals, over its mean, would rise without the term.
    """
    penalty = np.array([max(DEGREE_PENALTY[k], 1e-9) for k in degrees])
    scaled = A / np.sqrt(penalty)
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    worth = np.zeros(A.shape[1])
    for b, strength, error in zip(fit.coefficients.T, fit.strength, fit.error):
        spread = (vectors**2) @ (1 / (np.maximum(values, 0) + strength * len(A)))
        worth += b**2 * penalty / (spread * error)
    return worth
