"""The probe's face: a circular arc whose edges are rounded off. Units: mm."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SENSORS_MM: NDArray[np.float64] = np.arange(-11.25, 11.26, 1.5)
"""Centres of the sixteen sensors along the stroke, in the probe's frame."""

SENSOR_PITCH_MM = 1.5


@dataclass(frozen=True)
class ProbeShape:
    """Height of the face over its lowest point, f(s) = s^2/2R + k/6 max(|s| - a, 0)^3.

    The fillet is twice continuously differentiable: a kink in the slope makes Newton's method cycle.
    """

    radius_mm: float
    face_half_mm: float
    fillet_per_mm2: float

    def height(self, s: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """f, f' and f'' at probe coordinates `s` (n,), mm, 1 and 1/mm."""
        curvature = 0.0 if math.isinf(self.radius_mm) else 1.0 / self.radius_mm
        edge = np.maximum(np.abs(s) - self.face_half_mm, 0.0)
        k = self.fillet_per_mm2
        f = 0.5 * curvature * s * s + k / 6.0 * edge**3
        slope = curvature * s + 0.5 * k * edge**2 * np.sign(s)
        return f, slope, curvature + k * edge
