"""What a model that is told its tissue is trained and judged on: lumps over the whole range, plain tissue,
and tissues that it is to notice.

Cases are at their middle force; `any_tissue.at_forces` gives each the forces that it is simulated at.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from math import exp, log, log10
from typing import Any

import numpy as np
from scipy.stats import qmc

from palpate.sim.tissue import Case, sobol_cases
from palpate.sim.tissue.design import USUAL, Ranges

NO_LUMP_THICKNESS_MM = (4.0, 40.0)
RADIUS, STIFFENING = (1.05, 1.09), (1.0, 2.5)
"""By what factor the face's radius differs on other tissues, either way, and by how much more b the fat
stiffens."""

OUTSIDE = Ranges((4.0, 25.0), (0.2, 2.0), (1.3, 1000.0), (0.2, 1.2))
"""Wider in every input than the model's ranges. Lumps in here and not in there are its rim."""

Tissue = Mapping[str, Any]
"""Fields of `Case` that differ from the thesis' tissue and probe, as gland_ratio."""


def lump_cases(n: int, seed: int, tissue: Tissue, ranges: Ranges = USUAL) -> list[Case]:
    """`n` Sobol lumps over `ranges`."""
    return [replace(case, **tissue) for case in sobol_cases(n, seed, ranges)]


def rim_cases(n: int, seed: int, tissue: Tissue) -> list[Case]:
    """`n` lumps in `OUTSIDE` but not within the usual ranges."""
    return [case for case in lump_cases(4 * n, seed, tissue, OUTSIDE) if not inside(case)][:n]


def inside(case: Case, ranges: Ranges = USUAL) -> bool:
    """Whether a lump lies in the ranges that the model is for, the probe being the usual one."""
    named = [f.name for f in fields(ranges) if getattr(ranges, f.name) is not None]
    return all(getattr(ranges, n)[0] <= getattr(case, n) <= getattr(ranges, n)[1] for n in named)


def no_lump_cases(n: int, seed: int, tissue: Tissue) -> list[Case]:
    """`n` cases of plain tissue, its thickness even in its logarithm from 4 to 40 mm."""
    points = qmc.Sobol(2, seed=np.random.default_rng(seed)).random_base2(max(0, (n - 1).bit_length()))[:n]
    low, high = (log10(t) for t in NO_LUMP_THICKNESS_MM)
    F_low, F_high = USUAL.F_rel
    return [
        Case.without_lump(10 ** (low + (high - low) * u), F_low + (F_high - F_low) * v, **tissue)
        for u, v in points
    ]


def other_cases(n: int, seed: int, tissue: Tissue) -> list[Case]:
    """`n` tissues without a lump, each off in the face's radius or in how its fat stiffens, in turn."""
    rng = np.random.default_rng(seed)
    out = []
    for k, lump in enumerate(sobol_cases(n, seed)):
        usual = Case.without_lump(lump.t_mm, lump.F_rel, **tissue)
        if k % 2:
            b = usual.fat_stiffening + float(rng.uniform(*STIFFENING))
            out.append(replace(usual, fat_stiffening=round(b, 3)))
        else:
            way, low, high = (1 if k % 4 else -1), log(RADIUS[0]), log(RADIUS[1])
            radius = usual.probe_radius_mm * exp(way * rng.uniform(low, high))
            out.append(replace(usual, probe_radius_mm=round(radius, 3)))
    return out
