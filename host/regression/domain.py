"""Where the model may be believed: a box in each feature, and a distance over all of them.

Features of a stroke lie on a curved sheet of four inputs; a lump outside the training ranges mostly leaves
it, or its edges. The box catches single features out of range, the Mahalanobis distance their combination.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from host.features import Floats

SHRINKAGE = 1e-3


@dataclass(frozen=True)
class DomainCheck:
    """lo <= feature <= hi for all, and (z - centre)' precision (z - centre) <= threshold."""

    lo: Floats
    hi: Floats
    centre: Floats
    precision: Floats
    threshold: float

    def distance(self, z: Floats) -> Floats:
        """Squared Mahalanobis distance of standardised features (n, features)."""
        u = z - self.centre
        return np.einsum("ni,ij,nj->n", u, self.precision, u)

    def inside(self, features: Floats, z: Floats) -> NDArray[np.bool_]:
        """Whether each stroke may be believed."""
        boxed = ((features >= self.lo) & (features <= self.hi)).all(axis=1)
        return boxed & (self.distance(z) <= self.threshold)


def fit_domain(features: Floats, z: Floats, share_out: float = 0.025) -> DomainCheck:
    """A domain that leaves out about `share_out` of strokes like these.

    Parameters
    ----------
    features, z : (n, features)
        As they come, and standardised (both of calibration strokes).
    share_out : float
        Half of it goes to the box, split over its sides, half to the distance.
    """
    centre: Floats = z.mean(axis=0, dtype=np.float64)
    covariance: Floats = np.cov(z.T) + SHRINKAGE * np.eye(z.shape[1])
    precision: Floats = np.linalg.inv(covariance).astype(np.float64)
    tail = share_out / 2 / (2 * z.shape[1])
    lo, hi = np.quantile(features, [tail, 1 - tail], axis=0)
    room = 0.01 * (hi - lo)
    check = DomainCheck(lo - room, hi + room, centre, precision, np.inf)
    threshold = float(np.quantile(check.distance(z), 1 - share_out / 2))
    return DomainCheck(check.lo, check.hi, centre, check.precision, threshold)
