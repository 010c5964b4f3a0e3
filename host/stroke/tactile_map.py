"""The tactile map of a stroke that is still running, and its Gaussian fit. Units: mm, kPa.

Method 2 of the thesis (Figure 9): each row of sensors leaves a trace over the tissue; the traces are
averaged on a 1 mm grid. The probe computes the final map itself, in integers; this one only has to keep up
with the eye.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.features.gaussian import bounded_bump
from palpate.wire.cells import PITCH_MM, ROW_MM
from palpate.wire.events import MapFit

Array = NDArray[np.float64]
MIN_ROWS = len(ROW_MM) * 7 // 8
"""How many rows must have seen a place before it is shown."""
_WORST_FIT = 0.6


def peak_kPa(image_kPa: NDArray[np.floating]) -> float:
    """Highest mean over 3 x 3 cells of a (rows, columns) image: what one cell alone says may be its noise."""
    rows = image_kPa[:-2] + image_kPa[1:-1] + image_kPa[2:]
    return float((rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]).max()) / 9.0


def force_N_per_m(image_kPa: NDArray[np.floating]) -> float:
    """Force per metre of probe width: the pressures' integral along the stroke, mean over the columns."""
    return float(image_kPa.sum() * PITCH_MM / image_kPa.shape[1])


def columns_over_lump(images_kPa: Array) -> NDArray[np.intp]:
    """Which columns see the lump: a ball lies under a few of them only, and the others dilute it.

    Parameters
    ----------
    images_kPa : (n, rows, columns)

    Returns
    -------
    (k,) the columns whose pressure rises, along the stroke, at least half as much as that of the
    column where it rises most; all of them while nothing stands out
    """
    along = images_kPa.mean(axis=1)
    rise = along.max(axis=0) - np.median(along, axis=0)
    smooth = np.convolve(np.pad(rise, 1, mode="edge"), np.full(3, 1 / 3), mode="valid")
    if smooth.max() < 0.04 * along.mean():
        return np.arange(smooth.size)
    return np.flatnonzero(smooth >= 0.5 * smooth.max())


def method_2(position_mm: Array, row_kPa: Array) -> tuple[Array, Array, Array]:
    """Average the rows' traces over the tissue.

    Parameters
    ----------
    position_mm : (n,) probe positions along the stroke, mm
    row_kPa : (n, rows) pressure of each row, mean over the columns, kPa

    Returns
    -------
    x_mm : (m,) places on the tissue, 1 mm apart
    pressure_kPa : (m,) mean of the traces that reach there; where not all do, the face's own profile is
    allowed for rows : (m,) how many of the rows do; places that too few of them reach are left out
    """
    order = np.argsort(position_mm, kind="stable")
    position, row = position_mm[order], row_kPa[order]
    if position.size < 2 or position[-1] - position[0] < 1.0:
        return np.empty(0), np.empty(0), np.empty(0)
    x = np.arange(np.ceil(position[0] + ROW_MM[0]), np.floor(position[-1] + ROW_MM[-1]) + 0.5)
    traces = np.full((len(ROW_MM), x.size), np.nan)
    for i, s in enumerate(ROW_MM):
        traces[i] = np.interp(x, position + s, row[:, i], left=np.nan, right=np.nan)
    rows = np.isfinite(traces).sum(axis=0)
    keep = rows >= MIN_ROWS
    face = row_kPa.mean(axis=0) / max(float(row_kPa.mean()), 1e-9)
    share = (np.isfinite(traces) * face[:, None]).sum(axis=0)
    mean = np.nansum(traces, axis=0)[keep] / np.maximum(share[keep], 1e-9)
    return x[keep], mean, rows[keep].astype(np.float64)


def fit_growing_map(x_mm: Array, pressure_kPa: Array) -> MapFit | None:
    """Fit the map's bump; None where there is none to see yet (too few points, not past the top, a poor
    fit)."""
    if x_mm.size < 12:
        return None
    base, top = float(pressure_kPa.min()), float(pressure_kPa.max())
    if top - base < 1e-6 * max(top, 1.0):
        return None
    start = (max(base, 0.0), top - base, float(x_mm[int(pressure_kPa.argmax())]), 6.0)
    span = float(x_mm[-1] - x_mm[0])
    found = bounded_bump(
        x_mm,
        pressure_kPa,
        [start],
        (0.0, 0.0, x_mm[0], 1.5),
        (np.inf, 3.0 * (top - base), x_mm[-1], max(2.0, span)),
        tolerance=1e-8,
        most=60,
    )
    if found is None:
        return None
    p, residual = found
    seen_whole = x_mm[0] + p[3] / 2 < p[2] < x_mm[-1] - p[3] / 2 and p[3] > 1.6
    if not seen_whole or p[3] > 0.5 * span or residual > _WORST_FIT * float(np.std(pressure_kPa)):
        return None
    return MapFit(float(p[0]), float(p[1]), float(p[2]), float(p[3]))
