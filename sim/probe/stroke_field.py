"""A finite-element stroke as a field: the image at any position and near any force. Units: mm, kPa, N/m."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from palpate.errors import UsageError
from palpate.sim.probe.cells import COLUMN_MM, PITCH_MM, ROW_MM
from palpate.sim.tissue import Stroke
from palpate.sim.tissue.symmetry import both_sides

Floats = NDArray[np.float64]

FORCE_RATIO = 1.4


class StrokeField:
    """Images and displacement of one case at any position and, with a second stroke, near any force.

    Parameters
    ----------
    low : Stroke
        From at least 28 mm before the lump to over it; the other side is its mirror image. Over a solid
        lump its images are those of the whole face.
    high : Stroke, optional
        The same case at a greater force (FORCE_RATIO times). Between and around the two, pressures are
        interpolated in the logarithm where both are over .3 kPa, else linearly in the force.
    """

    def __init__(self, low: Stroke, high: Stroke | None = None) -> None:
        pair = [low] if high is None else [low, high]
        positions = low.positions_mm
        for s in pair:
            if len(s.positions_mm) != len(positions) or not np.allclose(s.positions_mm, positions):
                raise UsageError(f"{s.code} was simulated at other positions than {low.code}")
        if high is not None and not high.F_N_per_m > low.F_N_per_m:
            raise UsageError(f"{high.code} must be pressed harder than {low.code}")
        self.low = low
        images = [on_the_array(s) for s in pair]
        self.shape = images[0].shape[1:]
        self.pair = high is not None
        self.ln_ratio = float(np.log(high.F_N_per_m / low.F_N_per_m)) if high is not None else 1.0
        x, tables = positions, []
        for s, image in zip(pair, images, strict=True):
            depth = np.asarray(s.displacement_mm, float)
            if len(positions) == 1:
                x, image, depth = (
                    np.array([-40.0, 0.0, 40.0]),
                    np.repeat(image, 3, axis=0),
                    np.repeat(depth, 3),
                )
            else:
                x, image, depth = both_sides(positions, image, depth)
            tables.append(np.column_stack([image.reshape(len(x), -1), depth]))
        self.reach_mm = (float(x[0]), float(x[-1]))
        self._splines = [CubicSpline(x, t, axis=0) for t in tables]

    def at(self, position_mm: Floats, force_N_per_m: Floats | None = None) -> tuple[Floats, Floats]:
        """Images (n, rows), of a solid lump (n, rows, columns), in kPa, and displacement (n,) in mm.

        At the places (n,) and forces (n,).

        Outside the simulated places the last image stays.
        """
        x = np.clip(np.asarray(position_mm, float), *self.reach_mm)
        lo = np.maximum(self._splines[0](x), 0)
        if force_N_per_m is None:
            return self._parted(lo)
        u = np.log(np.asarray(force_N_per_m, float) / self.low.F_N_per_m)
        if not self.pair:
            if np.any(np.abs(u) > 1e-9):
                raise UsageError(f"{self.low.code} was simulated at one force only: the hand cannot vary it")
            return self._parted(lo)
        hi = np.maximum(self._splines[1](x), 0)
        share = (np.expm1(u) / np.expm1(self.ln_ratio))[:, None]
        linear = lo + share * (hi - lo)
        u = (u / self.ln_ratio)[:, None]
        loaded = (lo > 0.3) & (hi > 0.3)
        safe_lo, safe_hi = np.where(loaded, lo, 1.0), np.where(loaded, hi, 1.0)
        out = np.where(loaded, safe_lo ** (1 - u) * safe_hi**u, np.maximum(linear, 0))
        # displacement is always taken in the logarithm
        out[:, -1] = lo[:, -1] ** (1 - u[:, 0]) * hi[:, -1] ** u[:, 0]
        return self._parted(out)

    def _parted(self, table: Floats) -> tuple[Floats, Floats]:
        return table[:, :-1].reshape(-1, *self.shape), table[:, -1]


def on_the_array(stroke: Stroke) -> Floats:
    """A stroke's images (n, rows) or (n, rows, columns) as this probe's array feels them.

    The tissue gives mean pressures on sensors of its own; where the array's lie elsewhere, the force on each
    cell is taken from the running integral (monotone cubic: no force is lost, none turns negative). What lies
    beyond the tissue's sensors is not touched.
    """
    pressure = np.asarray(stroke.images_kPa, float)
    places = np.asarray(stroke.sensors_mm, float)
    pressure = _resampled(pressure, 1, places, ROW_MM)
    if pressure.ndim > 2:
        across = (np.arange(pressure.shape[2]) - (pressure.shape[2] - 1) / 2) * (places[1] - places[0])
        pressure = _resampled(pressure, 2, across, COLUMN_MM)
    return pressure


def _resampled(pressure: Floats, axis: int, places: Floats, wanted: Floats) -> Floats:
    if len(places) == len(wanted) and np.allclose(places, wanted):
        return pressure
    pitch = places[1] - places[0]
    edges = np.append(places - pitch / 2, places[-1] + pitch / 2)
    force = np.insert(np.cumsum(pressure * pitch, axis=axis), 0, 0.0, axis=axis)
    ends = np.append(wanted - PITCH_MM / 2, wanted[-1] + PITCH_MM / 2)
    running = PchipInterpolator(edges, force, axis=axis)(np.clip(ends, edges[0], edges[-1]))
    return np.diff(running, axis=axis) / PITCH_MM
