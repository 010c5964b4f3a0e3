"""Which terms belong in an equation: every subset tried, the one kept that predicts left-out runs best.

The thesis chose terms by their t-stats, P-values and adjusted R2; with six features and their squares every
subset can be tried instead, and PRESS (the sum of squared leave-one-out residuals, Allen 1974) judges them.
The choice is part of the model: `nested_leave_one_out` makes it afresh without each run in turn.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from palpate.errors import UsageError
from palpate.features.map_features import Floats

_LEVERAGE_MAX = 1 - 1e-6


@dataclass(frozen=True)
class Subset:
    """The columns kept, the weights (intercept first) and the PRESS they reach."""

    columns: tuple[int, ...]
    weights: Floats
    press: float

    def predict(self, X: Floats) -> Floats:
        """The equation's value for rows X (n, p)."""
        return self.weights[0] + X[:, list(self.columns)] @ self.weights[1:]


def best_subset(X: Floats, y: Floats, most_terms: int) -> Subset:
    """The subset of at most `most_terms` columns of X (n, p) with the least PRESS, an intercept always in.

    Raises
    ------
    UsageError
        Fewer rows than an equation with one term needs.
    """
    best: Subset | None = None
    for subsets, Q, R, leverage in _designs(X, most_terms):
        Qy = np.einsum("sni,n->si", Q, y)
        left = y - np.einsum("sni,si->sn", Q, Qy)
        press = ((left / (1 - leverage)) ** 2).sum(1)
        k = int(press.argmin())
        if best is None or press[k] < best.press:
            best = Subset(tuple(int(j) for j in subsets[k]), np.linalg.solve(R[k], Qy[k]), float(press[k]))
    if best is None:
        raise UsageError("every term is a copy of another")
    return best


def best_r2(X: Floats, Y: Floats, most_terms: int) -> Floats:
    """In-sample R2 of the subset that `best_subset` would choose for each column of Y (n, k), together.

    The subsets' factorisations serve all columns: a permutation test has a thousand of them.
    """
    press, rest = np.full(Y.shape[1], np.inf), np.empty(Y.shape[1])
    for _, Q, _, leverage in _designs(X, most_terms):
        for k, y in enumerate(Y.T):
            Qy = np.matmul(y, Q)
            left = y - np.matmul(Q, Qy[:, :, None])[:, :, 0]
            scores = np.square(left / (1 - leverage)).sum(1)
            j = int(scores.argmin())
            if scores[j] < press[k]:
                press[k], rest[k] = scores[j], np.square(left[j]).sum()
    return 1 - rest / np.square(Y - Y.mean(0)).sum(0)


def _designs(X: Floats, most_terms: int) -> Iterator[tuple[NDArray[np.intp], Floats, Floats, Floats]]:
    """All subsets of each size: columns (s, size), Q (s, n, size + 1), R, leverages (s, n)."""
    n, p = X.shape
    most_terms = min(most_terms, p, n - 3)
    if most_terms < 1:
        raise UsageError(f"{n} runs are too few to choose terms from")
    for size in range(1, most_terms + 1):
        subsets = np.array(list(combinations(range(p), size)))
        A = np.concatenate([np.ones((len(subsets), n, 1)), X[:, subsets].transpose(1, 0, 2)], axis=2)
        # A is short and thin: a QR of each gives weights and leverages without squaring its condition.
        Q, R = np.linalg.qr(A)
        sound = np.abs(np.diagonal(R, axis1=1, axis2=2)).min(1) > 1e-8
        Q, R, subsets = Q[sound], R[sound], subsets[sound]
        if len(subsets):
            yield subsets, Q, R, np.minimum(np.einsum("sni,sni->sn", Q, Q), _LEVERAGE_MAX)


def nested_leave_one_out(X: Floats, y: Floats, most_terms: int) -> tuple[Floats, list[tuple[int, ...]]]:
    """Estimate of every row by an equation chosen and fitted without it; and the terms chosen each time."""
    estimates, chosen = np.empty(len(y)), []
    for k in range(len(y)):
        rest = np.arange(len(y)) != k
        found = best_subset(X[rest], y[rest], most_terms)
        estimates[k] = found.predict(X[k : k + 1])[0]
        chosen.append(found.columns)
    return estimates, chosen
