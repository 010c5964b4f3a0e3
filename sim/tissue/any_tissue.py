"""A design of lumps in tissue that is not known beforehand: fat, gland, stiffening and face are drawn too.

Scaling is exact: with all moduli and the force times s, displacements stay and pressures go times s. So the
fat is 10 kPa throughout, and what is drawn is the force over the fat's modulus; one simulation serves every
fat (`observed`, in palpate.learn.any_tissue).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from palpate.sim.tissue.case import FORCE_UNIT_N_PER_M, Case
from palpate.sim.tissue.draws import LumpRanges, even, log_even, rounded, stiffness
from palpate.sim.tissue.settings import Settings

FORCE_PARTS = (1.4**-0.5, 1.0, 1.4**0.5)
"""Forces of each lump's strokes, over the middle one: room for a hand that wanders."""

PRESS_PARTS = (0.2, 0.25, 0.32, 0.4, 0.5, 0.63, 0.8, 1.0)
"""Forces of the press before the stroke, over the middle one. Rows where the contact ends bend between fewer:
a model that learnt from four told t a twentieth too large."""

REFERENCE_PARTS = (0.2, 0.4, 0.65, 1.0, 1.4)
"""Fewer of them, and one beyond the stroke's: of a press that costs much, or that need not be so exact."""

STROKES = Settings(hx_mm=1.0, shells=2, to_border=True, far_start_mm=-44.0)
"""The usual mesh, with straight lines to the border of the contact, made t another twentieth too large."""
PRESSES = replace(STROKES, far_start_mm=None, start_mm=-40.0, press_only=True)


@dataclass(frozen=True)
class TissueRanges(LumpRanges):
    """What the design covers; `even` in itself unless said otherwise. Lumps lie on the border.

    Attributes
    ----------
    reach_mm : tuple of float
        Force per metre of width over the fat's modulus, mm; even in its logarithm.
    gland_ratio, gland_mm : tuple of float
        The ratio is even in its logarithm.
    stiffening : tuple of float
        b of fat and of gland, each its own.
    linear : float
        Share of fats, and of glands, that do not stiffen at all.
    probe_radius_mm : tuple of float
    """

    reach_mm: tuple[float, float] = (2.5, 12.0)
    gland_ratio: tuple[float, float] = (1.0, 10.0)
    gland_mm: tuple[float, float] = (8.0, 30.0)
    stiffening: tuple[float, float] = (0.0, 3.0)
    linear: float = 0.15
    probe_radius_mm: tuple[float, float] = (38.0, 42.0)


OUTSIDE = TissueRanges(d_mm=(4.0, 25.0), h=(0.2, 2.0), E_ratio=(1.3, 1000.0))
"""Wider in what a model says of the lump; those lumps in here but not in the usual ranges are its rim."""


def rim_lumps(n: int, seed: int) -> list[Case]:
    """`n` lumps of `OUTSIDE` that lie outside the usual ranges, at their middle force."""
    usual = TissueRanges()
    rim = [case for case in random_lumps(6 * n, seed, OUTSIDE) if not usual.hold(case)]
    return rim[:n]


def plain_lumps(n: int, seed: int) -> list[Case]:
    """`n` tissues as random as any, of the thickness over a lump of the design, but without one."""
    of = ("F_rel", "gland_ratio", "gland_mm", "fat_stiffening", "gland_stiffening", "probe_radius_mm")
    return [
        Case.without_lump(c.t_mm, **{name: getattr(c, name) for name in of})
        for c in random_lumps(n, seed, TissueRanges())
    ]


def at_forces(lumps: list[Case], parts: tuple[float, ...]) -> list[Case]:
    """Each lump at these parts of its middle force: `FORCE_PARTS` for strokes, `PRESS_PARTS` for presses."""
    return [replace(case, F_rel=case.F_rel * part) for case in lumps for part in parts]


def any_tissue_cases(n: int, seed: int, ranges: TissueRanges | None = None) -> list[Case]:
    """3 n cases: `n` lumps of a scrambled Sobol sequence at three forces each; the same seed, the same cases.

    A lump that is too large for its gland is passed over.
    """
    return at_forces(random_lumps(n, seed, ranges or TissueRanges()), FORCE_PARTS)


def press_cases(n: int, seed: int, ranges: TissueRanges | None = None) -> list[Case]:
    """The same lumps at the forces of the press before the stroke, to be simulated with `PRESSES`."""
    return at_forces(random_lumps(n, seed, ranges or TissueRanges()), PRESS_PARTS)


def without_its_lump(case: Case, thickness: float = 1.0) -> Case:
    """The same layers under the same probe and force, and no lump in them; the fat's thickness times this."""
    same = replace(case, E_ratio=1.0, lump_stiffening=0.0)
    if case.solid or case.fat_mm is not None:
        return same
    # the mesh is made about a lump of middling size, where the gland has room for it
    plain = Case.without_lump(case.t_mm * thickness)
    if thickness == 1.0 and plain.d_mm / 2 > 0.9 * case.gland_mm:
        return same
    return replace(same, d_mm=plain.d_mm, h=plain.h)


def random_lumps(n: int, seed: int, r: TissueRanges) -> list[Case]:
    """`n` lumps of a scrambled Sobol sequence over these ranges, at their middle force."""
    found: list[Case] = []
    for of_d, of_h, of_E, of_force, of_ratio, of_gland, of_fat_b, of_gland_b, of_radius in _points(n, seed):
        d, gland = even(of_d, r.d_mm), even(of_gland, r.gland_mm)
        if d / 2 > 0.9 * gland:
            continue
        fat_kPa = Case(d, 1.0, 1.0).fat_kPa
        found.append(
            Case(
                d_mm=rounded(d),
                h=rounded(even(of_h, r.h)),
                E_ratio=rounded(stiffness(of_E, r.E_ratio)),
                F_rel=rounded(log_even(of_force, r.reach_mm) * fat_kPa / FORCE_UNIT_N_PER_M),
                gland_ratio=rounded(log_even(of_ratio, r.gland_ratio)),
                gland_mm=rounded(gland),
                fat_stiffening=stiffening(of_fat_b, r),
                gland_stiffening=stiffening(of_gland_b, r),
                probe_radius_mm=rounded(even(of_radius, r.probe_radius_mm)),
            )
        )
        if len(found) == n:
            break
    return found


def _points(n: int, seed: int) -> Iterator[np.ndarray]:
    """Twice as many as are asked for: a few lumps do not fit."""
    from scipy.stats import qmc

    yield from qmc.Sobol(9, seed=np.random.default_rng(seed)).random_base2(max(1, n.bit_length()) + 1)


def stiffening(u: float, r: TissueRanges) -> float:
    """b of a tissue: none for a share `r.linear` of u, even in `r.stiffening` for the rest."""
    return 0.0 if u < r.linear else rounded(even((u - r.linear) / (1.0 - r.linear), r.stiffening))
