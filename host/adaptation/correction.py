"""A shrunken correction on the link scale, learned from lumps that are known.

    y'_j = y_j + sum_k B_kj phi_k,   phi = 1, the model's predictions, its standardised features, its terms

The prior is the simulated model, B = 0; a ridge pulls towards it. How much of phi may be used, and how strong
the pull is, is chosen by leaving out whole lumps; something larger must be better than what is smaller by
more than the standard error of the difference. A lump counts once, however often it was stroked.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.features.map_features import Floats

NONE, OFFSET, SLOPES, FEATURES, TERMS = range(5)
WORDS = ("no correction", "an offset", "slopes over the outputs", "slopes over the features", "all terms")
_PULLS = {
    OFFSET: (4.0, 1.0, 0.0),
    SLOPES: (100.0, 30.0, 10.0, 3.0, 1.0),
    FEATURES: (300.0, 100.0, 30.0, 10.0, 3.0),
    TERMS: (1000.0, 300.0, 100.0, 30.0, 10.0, 3.0),
}
"""Strengths of the ridge, in lumps: with as many lumps half of what they say is believed."""
FEWEST = {OFFSET: 3, SLOPES: 5, FEATURES: 12, TERMS: 60}
"""Lumps from which a level is tried at all."""


@dataclass(frozen=True)
class Basis:
    """phi of n strokes, (n, columns), and at which level each column comes in, (columns)."""

    phi: Floats
    level: NDArray[np.int64]

    def means(self, group: NDArray[np.int64]) -> Basis:
        """The same of whole lumps, in the order of their numbers."""
        return Basis(mean_of(self.phi, group), self.level)


@dataclass(frozen=True)
class Correction:
    """One output's: its level, the strength of the pull in lumps, its coefficients (columns)."""

    level: int
    pull: float
    coefficients: Floats

    @property
    def words(self) -> str:
        """For people."""
        if self.level == NONE:
            return WORDS[NONE]
        lumps = f"{self.pull:g} lump" + ("s" if self.pull != 1 else "")
        return WORDS[self.level] + (f", pulled towards the model as if by {lumps}" if self.pull else "")


def mean_of(values: Floats, group: NDArray[np.int64]) -> Floats:
    """Means over each lump, (lumps, ...), in the order of their numbers."""
    return np.array([values[group == lump].mean(axis=0) for lump in np.unique(group)])


def fit(basis: Basis, residual: Floats) -> Correction:
    """Choose and fit the correction of one output.

    Parameters
    ----------
    basis : Basis
        Of whole lumps (`Basis.means`).
    residual : (lumps,)
        Truth less prediction, link scale.
    """
    columns = basis.phi.shape[1]
    best, errors = Correction(NONE, 0.0, np.zeros(columns)), residual**2
    for level, pull in _candidates(len(residual)):
        left = _left_out(basis, residual, level, pull)
        gain = errors - left**2
        if gain.mean() > gain.std(ddof=1) / np.sqrt(len(gain)):
            best, errors = Correction(level, pull, _ridge(basis, residual, level, pull)), left**2
    return best


def left_out(basis: Basis, residual: Floats) -> Iterator[Correction]:
    """For each lump the correction that is chosen and fitted without it."""
    for k in range(len(residual)):
        rest = np.arange(len(residual)) != k
        yield fit(Basis(basis.phi[rest], basis.level), residual[rest])


def _candidates(lumps: int) -> Iterator[tuple[int, float]]:
    for level, pulls in _PULLS.items():
        if lumps >= FEWEST[level]:
            for pull in pulls:
                yield level, pull


def _system(basis: Basis, level: int, pull: float) -> tuple[Floats, NDArray[np.int64], Floats]:
    used = np.flatnonzero(basis.level <= level)
    A = basis.phi[:, used]
    # An offset is what few lumps tell surely: only where it stands alone is it pulled, too.
    penalty = np.where(basis.level[used] == OFFSET, pull if level == OFFSET else 0.0, pull)
    return A, used, penalty


def _ridge(basis: Basis, residual: Floats, level: int, pull: float) -> Floats:
    A, used, penalty = _system(basis, level, pull)
    out = np.zeros(basis.phi.shape[1])
    out[used] = np.linalg.solve(A.T @ A + np.diag(penalty + 1e-9), A.T @ residual)
    return out


def _left_out(basis: Basis, residual: Floats, level: int, pull: float) -> Floats:
    """What is left of each lump's residual when it was left out, (lumps,), by the ridge's hat matrix."""
    A, _, penalty = _system(basis, level, pull)
    H = A @ np.linalg.solve(A.T @ A + np.diag(penalty + 1e-9), A.T)
    return np.asarray((residual - H @ residual) / np.maximum(1 - np.diag(H), 1e-6), float)
