"""The probe's face: a circular arc whose edges are rounded off. Units: mm."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray


@dataclass(frozen=True)
class ProbeShape:
    """Height of the face over its lowest point, f(s) = s^2/2R + k/6 max(|s| - a, 0)^3.

    The arc of radius R is the parabola s^2/2R: the circle of R = 40 stands .02 mm (1.6 %) higher at
    s = 10 mm.

    The fillet is twice continuously differentiable: a kink in the slope makes Newton's method cycle.
    """

    radius_mm: float
    face_half_mm: float
    fillet_per_mm2: float

    def height(self, s: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """f, f' and f'' at probe coordinates `s` (n,), mm, 1 and 1/mm."""
        curvature = 0.0 if math.isinf(self.radius_mm) else 1.0 / self.radius_mm
        # The third power stays NumPy's: its last bit need not be that of two products.
        cubes = np.maximum(np.abs(s) - self.face_half_mm, 0.0) ** 3
        return _height(s, cubes, curvature, self.face_half_mm, self.fillet_per_mm2)

    def derivatives(self, s: NDArray, by: str) -> tuple[NDArray, NDArray]:
        """Of f and f' (n,) by `probe_radius_mm`, `face_half_mm` or `fillet_per_mm2`."""
        edge, side = np.maximum(np.abs(s) - self.face_half_mm, 0.0), np.sign(s)
        if by == "probe_radius_mm":
            return -(s**2) / (2 * self.radius_mm**2), -s / self.radius_mm**2
        if by == "face_half_mm":
            return -0.5 * self.fillet_per_mm2 * edge**2, -self.fillet_per_mm2 * edge * side
        return edge**3 / 6, 0.5 * edge**2 * side


@njit(cache=True, nogil=True)
def _height(s, cubes, curvature, half, k):  # type: ignore[no-untyped-def]
    f = np.empty_like(s)
    slope = np.empty_like(s)
    bend = np.empty_like(s)
    for i in range(len(s)):
        edge = max(abs(s[i]) - half, 0.0)
        f[i] = 0.5 * curvature * s[i] * s[i] + k / 6.0 * cubes[i]
        slope[i] = curvature * s[i] + 0.5 * k * (edge * edge) * np.sign(s[i])
        bend[i] = curvature + k * edge
    return f, slope, bend
