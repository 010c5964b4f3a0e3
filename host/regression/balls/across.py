"""Where a lump lies across the stroke and how wide it is, from how much of its bump each column sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.sim.probe.cells import COLUMN_MM

_WIDTHS_MM = np.geomspace(1.6, 18.0, 14)
_PLACES_MM = np.arange(-18.0, 18.01, 0.5)


@dataclass(frozen=True)
class Across:
    """A Gaussian on a ground through the columns' responses: middle and standard deviation in mm, with the
    bump's mean over the face as a share of its peak."""

    place_mm: float
    width_mm: float
    share: float


def across(responses: NDArray[np.int64] | Floats) -> Across:
    """Fit the responses (columns,) of `firmware_py.columns`.

    Place, width and share are means over all Gaussians of the grid, each by its likelihood, so that they
    change evenly with the responses; where nothing stands out they come out in the middle of the grid.
    """
    r = np.asarray(responses, float)
    left = r - r.mean()
    with_bump = _BUMPS @ left
    height = np.maximum(with_bump, 0.0) / _NORMS
    misfit = left @ left - height * np.maximum(with_bump, 0.0)
    spare = len(r) - 4
    noise = max(float(misfit.min()), 1e-12 * float(left @ left) + 1e-12) / spare
    weight = np.exp(-(misfit - misfit.min()) / (2 * noise))
    weight /= weight.sum()
    place, ln_width = weight @ _GRID
    ground = r.mean() - height * _MEANS
    share = np.clip(r.mean() / np.maximum(ground + height, 1e-9), 0.0, 1.5)
    return Across(float(place), float(np.exp(ln_width)), float(weight @ share))


def place_mm(responses: Floats) -> Floats:
    """Where bumps lie across, (n,), from the columns' responses (n, columns)."""
    return np.array([across(row).place_mm for row in responses])


def _grid() -> tuple[Floats, Floats, Floats, Floats]:
    """Places and ln widths (n, 2), bumps less their means (n, columns), their squares' sums, their means."""
    places, widths = (axis.ravel() for axis in np.meshgrid(_PLACES_MM, _WIDTHS_MM))
    bumps = np.exp(-((COLUMN_MM - places[:, None]) ** 2) / (2 * widths[:, None] ** 2))
    means = bumps.mean(1)
    bumps = bumps - means[:, None]
    return np.column_stack([places, np.log(widths)]), bumps, (bumps**2).sum(1), means


_GRID, _BUMPS, _NORMS, _MEANS = _grid()
