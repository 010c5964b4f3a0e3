"""Pressures of one array as another one's cells feel them: no force is lost. Units: mm, kPa."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from firmware_py import geometry

Floats = NDArray[np.float64]

_PITCH_MM = geometry.PITCH_UM / 1000


def suits(rows: int, columns: int, pitch_mm: tuple[float, float]) -> bool:
    """Whether this is the array in use, so that nothing has to be resampled."""
    same = np.allclose(pitch_mm, _PITCH_MM, rtol=1e-3)
    return bool(same) and (rows, columns) == (geometry.ROWS, geometry.COLUMNS)


def onto_this_array(pressure: Floats, pitch_mm: tuple[float, float]) -> Floats:
    """Pressures (n, rows, columns) of another array on the cells of the array in use.

    The force on each cell comes from the running integral by monotone cubics: no force is lost, none turns
    negative. Across the stroke the outermost cells go on to the face's edge, for a face presses there as
    well; along it, what lies beyond the array is not touched.

    Parameters
    ----------
    pressure : (n, rows, columns)
    pitch_mm : (along, across)
    """
    along = _resampled(pressure, 1, pitch_mm[0], geometry.ROWS)
    return _resampled(_widened(along, pitch_mm[1]), 2, pitch_mm[1], geometry.COLUMNS)


def uncovered_mm(rows: int, columns: int, pitch_mm: tuple[float, float]) -> tuple[float, float]:
    """How much of this array's length and width the other one leaves out, mm."""
    along = geometry.ROWS * _PITCH_MM - rows * pitch_mm[0]
    across = geometry.COLUMNS * _PITCH_MM - columns * pitch_mm[1]
    return max(along, 0.0), max(across, 0.0)


def _widened(pressure: Floats, pitch_mm: float) -> Floats:
    gap = geometry.COLUMNS * _PITCH_MM - pressure.shape[2] * pitch_mm
    more = int(np.ceil(max(gap / 2, 0) / pitch_mm - 1e-9))
    return np.pad(pressure, ((0, 0), (0, 0), (more, more)), mode="edge")


def _resampled(pressure: Floats, axis: int, pitch_mm: float, cells: int) -> Floats:
    n = pressure.shape[axis]
    edges = pitch_mm * (np.arange(n + 1) - n / 2)
    running = np.insert(np.cumsum(pressure * pitch_mm, axis=axis), 0, 0.0, axis=axis)
    wanted = _PITCH_MM * (np.arange(cells + 1) - cells / 2)
    at = PchipInterpolator(edges, running, axis=axis)(np.clip(wanted, edges[0], edges[-1]))
    return np.asarray(np.diff(at, axis=axis) / _PITCH_MM, float)
