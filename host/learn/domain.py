"""Where the model is valid: a box in each feature, a distance over all, ranges of the estimates.

Features of a stroke lie on a curved sheet of four inputs. The box catches single features out of range, the
Mahalanobis distance their combination: another tissue, a broken sensor. A lump just outside the model's
ranges lies on the same sheet, only further on; its own estimate gives it away, since the model was also
trained on a rim of such lumps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from firmware_py import outputs as firmware_outputs
from palpate.features.map_features import Floats

SHRINKAGE = 1e-3
ROOM = 0.05
WIDER = 1.2
"""Box and squared distance are wider than what was seen by this share of the box, and by this factor: new
lumps in the ranges' corners are always a little beyond the old ones."""

LARGEST_MARGIN = 3.9
"""In half-widths; `palpate.model_export.check` refuses 4."""


@dataclass(frozen=True)
class DomainCheck:
    """lo <= feature <= hi for all, (z - centre)' precision (z - centre) <= threshold, estimates in range.

    An estimate is in range if it lies beyond `range_lo` to `range_hi` (link scale; infinite where there is
    no such end) by `margin` times half its interval at most.
    """

    lo: Floats
    hi: Floats
    centre: Floats
    precision: Floats
    threshold: float
    range_lo: Floats
    range_hi: Floats
    margin: float = 0.0

    def distance(self, z: Floats) -> Floats:
        """Squared Mahalanobis distance of standardised features (n, features)."""
        u = z - self.centre
        return np.einsum("ni,ij,nj->n", u, self.precision, u)

    def familiar(self, features: Floats, z: Floats) -> NDArray[np.bool_]:
        """Whether each stroke's features (n, features), standardised z, are like those in training, (n)."""
        boxed = ((features >= self.lo) & (features <= self.hi)).all(axis=1)
        return boxed & (self.distance(z) <= self.threshold)

    def beyond(self, y: Floats, half: Floats) -> Floats:
        """How far the worst of y (n, outputs) lies beyond its range, in half-widths, (n); negative inside."""
        return (np.maximum(self.range_lo - y, y - self.range_hi) / np.maximum(half, 1e-12)).max(axis=1)

    def inside(self, features: Floats, z: Floats, y: Floats, half: Floats) -> NDArray[np.bool_]:
        """Whether each stroke is inside the domain, (n); see `familiar` and `beyond`."""
        return self.familiar(features, z) & (self.beyond(y, half) <= self.margin)


def fit_domain(
    features: Floats, z: Floats, outputs: int = firmware_outputs.E_FAT, share_out: float = 0.025
) -> DomainCheck:
    """Box and distance that leave out at most about `share_out` of strokes like these; ranges without ends.

    Parameters
    ----------
    features, z : (n, features)
        As they come, and standardised (both of calibration strokes).
    outputs : int
        By default those of a model that was told its tissue.
    share_out : float
        Half of it goes to the box, split over its sides, half to the distance.
    """
    centre: Floats = z.mean(axis=0, dtype=np.float64)
    covariance: Floats = np.cov(z.T) + SHRINKAGE * np.eye(z.shape[1])
    precision: Floats = np.linalg.inv(covariance).astype(np.float64)
    tail = share_out / 2 / (2 * z.shape[1])
    lo, hi = np.quantile(features, [tail, 1 - tail], axis=0)
    room = ROOM * (hi - lo)
    endless = np.full(outputs, np.inf)
    check = DomainCheck(lo - room, hi + room, centre, precision, np.inf, -endless, endless)
    return replace(check, threshold=WIDER * float(np.quantile(check.distance(z), 1 - share_out / 2)))


def with_ranges(
    check: DomainCheck,
    range_lo: Floats,
    range_hi: Floats,
    familiar: NDArray[np.bool_],
    y: Floats,
    half: Floats,
    share_out: float,
) -> DomainCheck:
    """The same with ranges, their margin as small as leaves out `share_out` of strokes inside them in all.

    Parameters
    ----------
    range_lo, range_hi : (outputs)
        Link scale.
    familiar : (n)
        Whether strokes over lumps inside the ranges pass box and distance.
    y, half : (n, outputs)
        Out-of-fold estimates of these strokes, and half-widths.
    """
    check = replace(check, range_lo=range_lo, range_hi=range_hi)
    score = np.where(familiar, check.beyond(y, half), np.inf)
    margin = float(np.quantile(score, 1 - share_out, method="higher"))
    return replace(check, margin=min(max(margin, 0.0), LARGEST_MARGIN))
