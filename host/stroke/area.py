"""One stroke as a strip of an area map: how far the tissue under it stands out of its surroundings.

Method 2 of the thesis for each column of its own: every cell leaves a trace over the tissue, and what the
cells of a column say of a place is averaged. Units: mm, kPa; the rise is a share of the base.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.wire.cells import ROW_MM, SHAPE

Array = NDArray[np.float64]

_LEAST_TRAVEL_MM = 4.0
_RIM = 0.3
"""Of the mean base: columns at the rim that touch less than this must not make much of little."""


@dataclass(frozen=True)
class Strip:
    """The rise over the base.

    Attributes
    ----------
    x_mm : ndarray (m,)
        Places on the tissue along the stroke, 1 mm apart.
    rise : ndarray (m, columns)
        Pressure over the base, less 1.
    """

    x_mm: Array
    rise: Array


NOTHING = Strip(np.empty(0), np.empty((0, SHAPE[1])))


def strip(position_mm: Array, images_kPa: Array) -> Strip:
    """What the images of one stroke say of the tissue under it.

    The base of a cell is its median along the stroke. Each image counts against its own mean pressure, so
    that a hand that presses now more, now less draws no lumps. Places that at least half of the rows have
    passed are shown.

    Parameters
    ----------
    position_mm : (n,) the probe's positions along the stroke
    images_kPa : (n, rows, columns)
    """
    shares, touching = _shares(images_kPa)
    order = np.argsort(position_mm[touching], kind="stable")
    position, shares = position_mm[touching][order], shares[order]
    if position.size < 4 or position[-1] - position[0] < _LEAST_TRAVEL_MM:
        return NOTHING
    base = np.median(shares, axis=0)
    x = np.arange(np.ceil(position[0]), np.floor(position[-1]) + 0.5)
    rise, under = np.zeros((x.size, shares.shape[2])), np.zeros((x.size, shares.shape[2]))
    for row, s in enumerate(ROW_MM):
        there = (x - s >= position[0]) & (x - s <= position[-1])
        rise[there] += _between(position, shares[:, row], x[there] - s) - base[row]
        under[there] += base[row]
    least = _RIM * under.mean(axis=1, keepdims=True)
    return Strip(x, rise / np.maximum(np.maximum(under, least), 1e-9))


def base(images_kPa: Array) -> Array | None:
    """Each cell's median along a stroke (rows, columns), as a share of its image's mean; None of no images.

    Parameters
    ----------
    images_kPa : (n, rows, columns)
    """
    shares, _ = _shares(images_kPa)
    return np.median(shares, axis=0) if len(shares) else None


def _shares(images_kPa: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The images that touched the tissue, each over its mean pressure; and which those are."""
    mean = images_kPa.mean(axis=(1, 2))
    touching = mean > 0.5 * np.median(mean) if mean.size else np.zeros(0, bool)
    return images_kPa[touching] / mean[touching, None, None], touching


def _between(at: Array, values: Array, wanted: Array) -> Array:
    """Linear interpolation of values (n, columns) at rising places (n,)."""
    right = np.clip(np.searchsorted(at, wanted), 1, at.size - 1)
    width = np.maximum(at[right] - at[right - 1], 1e-9)
    share = np.clip((wanted - at[right - 1]) / width, 0.0, 1.0)[:, None]
    return values[right - 1] * (1 - share) + values[right] * share
