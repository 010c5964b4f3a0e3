"""A design of lumps that lie anywhere: wholly in the fat, on the border, or deep in the gland.

As `any_tissue`, whose tissue, forces and settings these are, but the fat's thickness is drawn for itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from palpate.sim.tissue.any_tissue import (
    FORCE_PARTS,
    PRESS_PARTS,
    TissueRanges,
    at_forces,
    stiffening,
)
from palpate.sim.tissue.case import FORCE_UNIT_N_PER_M, Case
from palpate.sim.tissue.draws import even, log_even, rounded, stiffness
from palpate.sim.tissue.errors import CaseError


@dataclass(frozen=True)
class PlaceRanges:
    """Where the lump lies; both even in their logarithms.

    Attributes
    ----------
    depth_mm : tuple of float
        Tissue over the lump; at most what is there, less the lump.
    fat_mm : tuple of float
    """

    depth_mm: tuple[float, float] = (2.0, 30.0)
    fat_mm: tuple[float, float] = (4.0, 30.0)


OUTSIDE = replace(TissueRanges(), d_mm=(4.0, 25.0), E_ratio=(1.3, 1000.0)), PlaceRanges(fat_mm=(3.0, 40.0))
"""Wider in d, E and the fat's thickness; those lumps in here but not in the usual ranges are the rim."""


def anywhere_cases(n: int, seed: int) -> list[Case]:
    """3 n cases: `n` lumps of a scrambled Sobol sequence at three forces each; the same seed, the same cases.

    A lump that does not fit over the chest wall is passed over.
    """
    return at_forces(anywhere_lumps(n, seed), FORCE_PARTS)


def anywhere_press_cases(n: int, seed: int) -> list[Case]:
    """The same lumps at the forces of the press before the stroke, for `any_tissue.PRESSES`."""
    return at_forces(anywhere_lumps(n, seed), PRESS_PARTS)


def anywhere_rim(n: int, seed: int) -> list[Case]:
    """`n` lumps of `OUTSIDE` that lie outside the usual ranges, at their middle force."""
    usual, place = TissueRanges(), PlaceRanges()
    rim = [
        case
        for case in anywhere_lumps(6 * n, seed, *OUTSIDE)
        if not (
            _within(case.d_mm, usual.d_mm)
            and _within(case.E_ratio, usual.E_ratio)
            and _within(case.t_mm, place.fat_mm)
        )
    ]
    return rim[:n]


def anywhere_plain(n: int, seed: int) -> list[Case]:
    """`n` tissues as random as any of the design, without a lump."""
    return [replace(case, E_ratio=1.0) for case in anywhere_lumps(n, seed)]


def anywhere_lumps(
    n: int, seed: int, tissue: TissueRanges | None = None, place: PlaceRanges | None = None
) -> list[Case]:
    """`n` lumps of the sequence over these ranges, at their middle force."""
    tissue, place = tissue or TissueRanges(), place or PlaceRanges()
    found: list[Case] = []
    points = _points(n, seed)
    while len(found) < n:
        try:
            found.append(_lump(next(points), tissue, place))
        except CaseError:
            continue
    return found


def _within(value: float, ends: tuple[float, float]) -> bool:
    return ends[0] <= value <= ends[1]


def _lump(point: np.ndarray, r: TissueRanges, place: PlaceRanges) -> Case:
    of_d, of_depth, of_fat, of_E, of_force, of_ratio, of_gland, of_fat_b, of_gland_b, of_radius = point
    d = rounded(even(of_d, r.d_mm))
    reach = log_even(of_force, r.reach_mm)
    return Case(
        d_mm=d,
        h=rounded(log_even(of_depth, place.depth_mm) / d),
        E_ratio=rounded(stiffness(of_E, r.E_ratio)),
        F_rel=rounded(reach * 10.0 / FORCE_UNIT_N_PER_M),
        gland_ratio=rounded(log_even(of_ratio, r.gland_ratio)),
        gland_mm=rounded(even(of_gland, r.gland_mm)),
        fat_stiffening=stiffening(of_fat_b, r),
        gland_stiffening=stiffening(of_gland_b, r),
        probe_radius_mm=rounded(even(of_radius, r.probe_radius_mm)),
        fat_mm=rounded(log_even(of_fat, place.fat_mm)),
        fat_kPa=10.0,
    )


def _points(n: int, seed: int) -> Iterator[np.ndarray]:
    """Points of one sequence, eight times as many as are asked for: a quarter of the lumps do not fit."""
    from scipy.stats import qmc

    yield from qmc.Sobol(10, seed=np.random.default_rng(seed)).random_base2(max(1, n.bit_length()) + 3)
