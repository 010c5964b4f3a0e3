"""Designs of solid lumps: balls and ellipsoids anywhere under the face, in tissue that is not known
beforehand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.any_tissue import FORCE_PARTS
from palpate.sim.tissue.case import FORCE_UNIT_N_PER_M, Case
from palpate.sim.tissue.draws import LumpRanges, even, log_even, rounded, stiffness

Floats = NDArray[np.float64]

_COEFFICIENT_MM = 3.24
"""Displacement at F = 1 in 13 mm of fat over a usual gland; it goes as F^.62 t^.67."""


@dataclass(frozen=True)
class SolidRanges(LumpRanges):
    """What a design of solid lumps covers: by default tissue as random as that of `any_tissue_cases`.

    Attributes
    ----------
    strain : tuple of float
        Nominal strain of the fat at the greatest of three forces, as usual tissue would have it.
    reach_mm : tuple of float
        Middle force per metre of width over the fat's modulus, mm: no strain takes it beyond.
    gland_ratio, gland_mm : tuple of float
        The ratio is even in its logarithm.
    stiffening : tuple of float
        b of fat and of gland, each its own.
    probe_radius_mm : tuple of float
    aspect : tuple of float
        Half-axes across and down over that along, for the lumps that are no balls; even in the logarithm.
    offset_mm : tuple of float
        Beside the stroke's line, for the lumps that are not on it.
    balls, on_line : float
        Share of lumps that are balls, and of those on the line, which cost a quarter of the others.
    """

    strain: tuple[float, float] = (0.08, 0.22)
    reach_mm: tuple[float, float] = (2.0, 9.0)
    gland_ratio: tuple[float, float] = (2.0, 10.0)
    gland_mm: tuple[float, float] = (8.0, 30.0)
    stiffening: tuple[float, float] = (0.0, 3.0)
    probe_radius_mm: tuple[float, float] = (38.0, 42.0)
    aspect: tuple[float, float] = (0.6, 1.6)
    offset_mm: tuple[float, float] = (0.0, 10.0)
    balls: float = 0.5
    on_line: float = 0.75


WIDEST = SolidRanges(
    d_mm=(4.0, 22.0), h=(0.15, 2.0), E_ratio=(1.0, 1000.0), reach_mm=(0.1, 30.0), on_line=0.5
)
"""All that the solver is asked to get through."""

SOFT_GLAND = SolidRanges(gland_ratio=(1.0, 2.0), on_line=0.9)
"""Tissue of nearly one material, as Samani (2007) finds it and as phantoms are made."""

DEEP = SolidRanges(d_mm=(4.0, 12.0), h=(1.0, 2.4), gland_ratio=(1.0, 10.0), on_line=0.9)
"""Small lumps that lie deep, half of them outside the usual ranges: as phantoms have them."""

COVERED = SolidRanges(gland_ratio=(SOFT_GLAND.gland_ratio[0], SolidRanges.gland_ratio[1]))
"""What a model of solid lumps is for: usual tissue and that of a soft gland."""


def ball_cases(n: int, seed: int, ranges: SolidRanges | None = None) -> list[Case]:
    """3 n cases: `n` lumps of a scrambled Sobol sequence at three forces each; the same seed, the same cases.

    A longer design begins with the shorter, so that a set can grow, and whatever there is of it is a fair
    sample. The border between fat and gland passes through the lump's middle. A gland that is too thin for
    its lump is made as deep as it has to be.
    """
    from scipy.stats import qmc

    r = ranges or SolidRanges()
    bits = max(0, (n - 1).bit_length())
    points = qmc.Sobol(14, seed=np.random.default_rng(seed)).random_base2(bits)[:n]
    lumps = [_lump(point, r) for point in points]
    return [replace(lump, F_rel=lump.F_rel * part) for lump in lumps for part in FORCE_PARTS]


RIM = SolidRanges(d_mm=(4.0, 25.0), h=(0.2, 2.0), E_ratio=(1.3, 1000.0), on_line=1.0)
"""Wider in every input than what a model of solid lumps is for; on the line, where lumps are cheap."""


def rim_cases(n: int, seed: int) -> list[Case]:
    """3 n cases: lumps in `RIM` but not within the usual ranges, to test what a model says of them.

    As of `ball_cases`, a longer design begins with the shorter.
    """
    usual = SolidRanges()
    drawn = ball_cases(4 * n, seed, RIM)
    middle = drawn[1 :: len(FORCE_PARTS)]
    outside = [k for k, case in enumerate(middle) if not usual.hold(case)][:n]
    return [case for k in outside for case in drawn[len(FORCE_PARTS) * k : len(FORCE_PARTS) * (k + 1)]]


def soft_gland_cases(n: int, seed: int) -> list[Case]:
    """3 n cases of `SOFT_GLAND`, as `ball_cases`."""
    return ball_cases(n, seed, SOFT_GLAND)


def deep_cases(n: int, seed: int) -> list[Case]:
    """3 n cases of `DEEP`, as `ball_cases`."""
    return ball_cases(n, seed, DEEP)


def _lump(point: Floats, r: SolidRanges) -> Case:
    """The lump of a point (14,) of the unit cube, at its middle force."""
    of_d, of_h, of_E, of_shape, of_line, of_across, of_down, of_gland, *rest = point
    of_ratio, of_offset, of_force, of_fat_b, of_gland_b, of_radius = rest
    d, h = even(of_d, r.d_mm), even(of_h, r.h)
    low, high = r.E_ratio
    E = min(max(stiffness(of_E, r.E_ratio), low), high)
    ball, on_line = of_shape < r.balls, of_line < r.on_line
    across, down = (log_even(v, r.aspect) * d / 2 for v in (of_across, of_down))
    half_down = d / 2 if ball else down
    gland = max(even(of_gland, r.gland_mm), 1.1 * half_down + 1.0)
    case = Case(
        d_mm=rounded(d),
        h=rounded(h),
        E_ratio=rounded(E),
        gland_ratio=rounded(log_even(of_ratio, r.gland_ratio)),
        gland_mm=rounded(gland),
        fat_stiffening=rounded(even(of_fat_b, r.stiffening)),
        gland_stiffening=rounded(even(of_gland_b, r.stiffening)),
        probe_radius_mm=rounded(even(of_radius, r.probe_radius_mm)),
        shape="ball" if ball else "ellipsoid",
        half_across_mm=None if ball else rounded(across),
        half_down_mm=None if ball else rounded(down),
        offset_mm=0.0 if on_line else rounded(even(of_offset, r.offset_mm)),
    )
    return replace(case, F_rel=rounded(_force(of_force, case, r)))


def _force(u: float, case: Case, r: SolidRanges) -> float:
    """A middle force within both strain and reach, even in its logarithm."""
    one_mm = case.fat_kPa / FORCE_UNIT_N_PER_M
    weak, strong = (_force_for(strain, case.t_mm) / FORCE_PARTS[-1] for strain in r.strain)
    low, high = r.reach_mm[0] * one_mm, r.reach_mm[1] * one_mm
    return log_even(u, (min(max(weak, low), high), max(min(strong, high), low)))


def _force_for(strain: float, t_mm: float) -> float:
    return float((strain * t_mm / (_COEFFICIENT_MM * (t_mm / 13.0) ** 0.67)) ** (1 / 0.62))
