"""A finite-element stroke as a field: the image at any position and near any force. Units: mm, kPa, N/m."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sim.tissue import Stroke

Floats = NDArray[np.float64]

FORCE_RATIO = 1.4


class StrokeField:
    """Images and displacement of one case at any position and, with a second stroke, near any force.

    Parameters
    ----------
    low : Stroke
        From at least 28 mm before the lump to over it; the other side is its mirror image.
    high : Stroke, optional
        The same case at a greater force (FORCE_RATIO times). Between and around the two, pressures are
        interpolated in the logarithm where both are over .3 kPa, else linearly in the force.
    """

    def __init__(self, low: Stroke, high: Stroke | None = None) -> None:
        pair = [low] if high is None else [low, high]
        positions = low.positions_mm
        for s in pair:
            if len(s.positions_mm) != len(positions) or not np.allclose(s.positions_mm, positions):
                raise ValueError(f"{s.code} was simulated at other positions than {low.code}")
        if high is not None and not high.F_N_per_m > low.F_N_per_m:
            raise ValueError(f"{high.code} must be pressed harder than {low.code}")
        self.low = low
        self.pair = high is not None
        self.ln_ratio = float(np.log(high.F_N_per_m / low.F_N_per_m)) if high is not None else 1.0
        one_sided = positions[-1] < 1e-9
        tables = []
        for s in pair:
            table = np.column_stack([s.images_kPa, s.displacement_mm])
            if len(positions) == 1:
                table = np.repeat(table, 3, axis=0)
            elif one_sided:
                back = np.column_stack([s.images_kPa[-2::-1, ::-1], s.displacement_mm[-2::-1]])
                table = np.concatenate([table, back])
            tables.append(table)
        if len(positions) == 1:
            x = np.array([-40.0, 0.0, 40.0])
        else:
            x = np.concatenate([positions, -positions[-2::-1]]) if one_sided else positions
        self.reach_mm = (float(x[0]), float(x[-1]))
        self._splines = [CubicSpline(x, t, axis=0) for t in tables]

    def at(self, position_mm: Floats, force_N_per_m: Floats | None = None) -> tuple[Floats, Floats]:
        """Images (n, 16) in kPa and displacement (n,) in mm at the places (n,) and forces (n,).

        Outside the simulated places the last image stays.
        """
        x = np.clip(np.asarray(position_mm, float), *self.reach_mm)
        lo = np.maximum(self._splines[0](x), 0)
        if force_N_per_m is None:
            return lo[:, :16], lo[:, 16]
        u = np.log(np.asarray(force_N_per_m, float) / self.low.F_N_per_m)
        if not self.pair:
            if np.any(np.abs(u) > 1e-9):
                raise ValueError(f"{self.low.code} was simulated at one force only: the hand cannot vary it")
            return lo[:, :16], lo[:, 16]
        hi = np.maximum(self._splines[1](x), 0)
        share = (np.expm1(u) / np.expm1(self.ln_ratio))[:, None]
        linear = lo + share * (hi - lo)
        u = (u / self.ln_ratio)[:, None]
        loaded = (lo > 0.3) & (hi > 0.3)
        safe_lo, safe_hi = np.where(loaded, lo, 1.0), np.where(loaded, hi, 1.0)
        out = np.where(loaded, safe_lo ** (1 - u) * safe_hi**u, np.maximum(linear, 0))
        # displacement is always taken in the logarithm
        out[:, 16] = lo[:, 16] ** (1 - u[:, 0]) * hi[:, 16] ** u[:, 0]
        return out[:, :16], out[:, 16]
