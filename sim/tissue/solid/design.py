"""Designs of solid lumps: balls and ellipsoids anywhere under the face, in tissue that is not known
beforehand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.case import Case

Floats = NDArray[np.float64]

FORCE_RATIO = 1.4
"""Greater over smaller force of each lump's two strokes: room for a hand that wanders."""

_COEFFICIENT_MM = 3.24
"""Displacement at F = 1 in 13 mm of fat over a usual gland; it goes as F^.62 t^.67."""


@dataclass(frozen=True)
class SolidRanges:
    """What a design of solid lumps covers.

    Attributes
    ----------
    d_mm, h : tuple of float
        Width along the stroke, and depth in widths.
    E_ratio : tuple of float
        Even in E^-2/3.
    strain : tuple of float
        Nominal strain of the fat at the greater of two forces, as usual tissue would have it.
    gland_ratio, gland_mm : tuple of float
        The ratio is even in its logarithm.
    aspect : tuple of float
        Half-axes across and down over that along, for the lumps that are no balls; even in the logarithm.
    offset_mm : tuple of float
        Beside the stroke's line, for the lumps that are not on it.
    balls, on_line : float
        Share of lumps that are balls, and of those on the line.
    """

    d_mm: tuple[float, float] = (4.0, 22.0)
    h: tuple[float, float] = (0.15, 2.0)
    E_ratio: tuple[float, float] = (1.0, 1000.0)
    strain: tuple[float, float] = (0.08, 0.22)
    gland_ratio: tuple[float, float] = (2.0, 10.0)
    gland_mm: tuple[float, float] = (8.0, 30.0)
    aspect: tuple[float, float] = (0.6, 1.6)
    offset_mm: tuple[float, float] = (0.0, 10.0)
    balls: float = 0.5
    on_line: float = 0.5


def ball_cases(n: int, seed: int, ranges: SolidRanges | None = None) -> list[Case]:
    """`n` lumps of a scrambled Sobol sequence, each at two forces; the same seed gives the same cases.

    The border between fat and gland passes through the lump's middle. A gland that is too thin for its lump
    is made as deep as it has to be.
    """
    from scipy.stats import qmc

    r = ranges or SolidRanges()
    bits = max(0, (n - 1).bit_length())
    points = qmc.Sobol(11, seed=np.random.default_rng(seed)).random_base2(bits)[:n]
    cases = []
    for point in points:
        of_d, of_h, of_E, of_shape, of_line, of_across, of_down, of_gland, *rest = point
        of_ratio, of_offset, of_strain = rest
        d, h = _even(of_d, r.d_mm), _even(of_h, r.h)
        low, high = r.E_ratio
        E = min(max(_even(of_E, (high ** (-2 / 3), low ** (-2 / 3))) ** -1.5, low), high)
        ball, on_line = of_shape < r.balls, of_line < r.on_line
        across, down = (_log_even(v, r.aspect) * d / 2 for v in (of_across, of_down))
        half_down = d / 2 if ball else down
        gland = max(_even(of_gland, r.gland_mm), 1.1 * half_down + 1.0)
        case = Case(
            d_mm=_rounded(d),
            h=_rounded(h),
            E_ratio=_rounded(E),
            gland_ratio=_rounded(_log_even(of_ratio, r.gland_ratio)),
            gland_mm=_rounded(gland),
            shape="ball" if ball else "ellipsoid",
            half_across_mm=None if ball else _rounded(across),
            half_down_mm=None if ball else _rounded(down),
            offset_mm=0.0 if on_line else _rounded(_even(of_offset, r.offset_mm)),
        )
        force = _force_for(_even(of_strain, r.strain), case.t_mm)
        cases += [replace(case, F_rel=_rounded(force / FORCE_RATIO)), replace(case, F_rel=_rounded(force))]
    return cases


def _force_for(strain: float, t_mm: float) -> float:
    return float((strain * t_mm / (_COEFFICIENT_MM * (t_mm / 13.0) ** 0.67)) ** (1 / 0.62))


def _even(u: float, limits: tuple[float, float]) -> float:
    return limits[0] + (limits[1] - limits[0]) * u


def _log_even(u: float, limits: tuple[float, float]) -> float:
    return float(np.exp(_even(u, (np.log(limits[0]), np.log(limits[1])))))


def _rounded(value: float) -> float:
    """Four digits, so that codes stay readable."""
    return float(f"{value:.4g}")
