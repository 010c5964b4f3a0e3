"""What a probe feels of a solid lump, as a stroke, and the press before strokes at rising forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.case import FORCE_UNIT_N_PER_M, Case
from palpate.sim.tissue.face_sensors import WIDTH_MM
from palpate.sim.tissue.result import Stroke
from palpate.sim.tissue.solid.kept import KeptStroke
from palpate.sim.tissue.solid.result import SolidStroke

Floats = NDArray[np.float64]


def press_before(rising: Sequence[KeptStroke | SolidStroke]) -> tuple[Stroke, ...]:
    """The press before strokes at rising forces: the ramp below the least, and where each stroke begins."""
    first = rising[0]
    unit_N = FORCE_UNIT_N_PER_M * WIDTH_MM / 1000
    at, parts = first.positions_mm[:1], []
    for force_N, depth, image in zip(first.ramp_N, first.ramp_displacement_mm, first.ramp_images_kPa):
        case = replace(first.case, F_rel=float(force_N) / unit_N)
        parts.append(felt(case, at, np.array([depth]), image[None]))
    for k in rising:
        parts.append(felt(k.case, at, k.displacement_mm[:1], k.images_kPa[:1]))
    return tuple(parts)


def felt(case: Case, positions_mm: Floats, displacement_mm: Floats, images_kPa: Floats) -> SolidStroke:
    """A stroke of which only what the probe feels is known; the rest is NaN.

    Images (n, 16, 26), the others (n,).
    """
    n = len(positions_mm)
    unknown, none = np.full(n, np.nan), np.empty(0)
    return SolidStroke(
        case=case,
        positions_mm=positions_mm,
        displacement_mm=displacement_mm,
        images_kPa=images_kPa,
        peak_mm=unknown,
        peak_kPa=unknown,
        contact_mm=np.full((n, 2), np.nan),
        force_error=unknown,
        smallest_jacobian=unknown,
        iterations=np.zeros(n, np.int64),
        factorisations=0,
        nodes=0,
        cpu_s=0.0,
        peak_across_mm=unknown,
        ramp_N=none,
        ramp_displacement_mm=none,
        ramp_images_kPa=np.empty((0, *images_kPa.shape[1:])),
    )
