"""How designs draw lumps: what all of them cover, and shares of a range. Units: mm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.sim.tissue.case import Case


@dataclass(frozen=True)
class LumpRanges:
    """What a design covers of its lumps.

    Attributes
    ----------
    d_mm, h : tuple of float
        Width along the stroke, and depth in widths.
    E_ratio : tuple of float
        Even in E^-2/3.
    """

    d_mm: tuple[float, float] = (5.0, 20.0)
    h: tuple[float, float] = (0.3, 1.5)
    E_ratio: tuple[float, float] = (2.0, 1000.0)

    def hold(self, case: Case) -> bool:
        """Whether the lump's diameter, depth and stiffness lie within these ranges."""
        limits = ((case.d_mm, self.d_mm), (case.h, self.h), (case.E_ratio, self.E_ratio))
        return all(low <= value <= high for value, (low, high) in limits)


def even(u: float, limits: tuple[float, float]) -> float:
    """The value a share `u` of the way between the limits."""
    return float(limits[0] + (limits[1] - limits[0]) * u)


def log_even(u: float, limits: tuple[float, float]) -> float:
    """The same by logarithms."""
    return float(np.exp(even(u, (np.log(limits[0]), np.log(limits[1])))))


def stiffness(u: float, limits: tuple[float, float]) -> float:
    """E over the fat's, a share `u` of the way from the stiff limit to the soft one by E^-2/3."""
    return even(u, (limits[1] ** (-2 / 3), limits[0] ** (-2 / 3))) ** -1.5


def rounded(value: float) -> float:
    """Four digits, so that codes stay readable."""
    return float(f"{value:.4g}")
