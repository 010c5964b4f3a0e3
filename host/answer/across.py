"""Where a bump lies across the stroke and how wide it is, from how much of it each column sees."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.wire.cells import COLUMN_MM

Floats = NDArray[np.float64]

_WIDTHS_MM = np.geomspace(1.6, 18.0, 14)
_PLACES_MM = np.arange(-180, 181) / 10
"""So fine that the clearest of bumps, with its likelihood in one place of the grid, is where it is."""
_CLEAREST = 0.003
"""Of the blur: under it nothing becomes clearer."""


@dataclass(frozen=True)
class AcrossFit:
    """A Gaussian on a ground through the columns' responses.

    Attributes
    ----------
    place_mm, width_mm : float
        Its middle and its standard deviation.
    share : float
        The bump's mean over the face, of its peak.
    blur : float
        Share of the columns' variance that it leaves unexplained, 0 to 1.
    """

    place_mm: float
    width_mm: float
    share: float
    blur: float

    @property
    def ln_blur(self) -> float:
        """Its logarithm, even where nearly nothing is left unexplained."""
        return math.log(self.blur + _CLEAREST)


def across(responses: NDArray[np.int64] | Floats) -> AcrossFit:
    """Fit the responses (columns,) of `firmware_py.columns`.

    Place, width and share are means over all Gaussians of the grid, each by its likelihood, so that they
    change evenly with the responses; where nothing stands out they come out in the middle of the grid.
    """
    r = np.asarray(responses, float)
    left = r - r.mean()
    with_bump = _BUMPS @ left
    height = np.maximum(with_bump, 0.0) / _NORMS
    misfit = left @ left - height * np.maximum(with_bump, 0.0)
    spare, all_of_it = len(r) - 4, float(left @ left)
    noise = max(float(misfit.min()), 1e-12 * all_of_it + 1e-12) / spare
    weight = np.exp(-(misfit - misfit.min()) / (2 * noise))
    weight /= weight.sum()
    place, ln_width = weight @ _GRID
    ground = r.mean() - height * _MEANS
    share = np.clip(r.mean() / np.maximum(ground + height, 1e-9), 0.0, 1.5)
    blur = max(float(misfit.min()), 0.0) / all_of_it if all_of_it > 0 else 1.0
    return AcrossFit(float(place), float(np.exp(ln_width)), float(weight @ share), min(blur, 1.0))


def places(responses: Floats) -> tuple[Floats, Floats]:
    """Where bumps lie across, mm, and their `ln_blur`, (n,) each, from columns' responses (n, columns)."""
    seen = [across(row) for row in responses]
    return np.array([one.place_mm for one in seen]), np.array([one.ln_blur for one in seen])


def _grid() -> tuple[Floats, Floats, Floats, Floats]:
    """Places and ln widths (n, 2), bumps less their means (n, columns), their squares' sums, their means."""
    places, widths = (axis.ravel() for axis in np.meshgrid(_PLACES_MM, _WIDTHS_MM))
    bumps = np.exp(-((COLUMN_MM - places[:, None]) ** 2) / (2 * widths[:, None] ** 2))
    means = bumps.mean(1)
    bumps = bumps - means[:, None]
    return np.column_stack([places, np.log(widths)]), bumps, (bumps**2).sum(1), means


_GRID, _BUMPS, _NORMS, _MEANS = _grid()
