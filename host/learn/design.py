"""What a told model is trained and judged on: lumps over the whole range, each at three forces, and presses.

The hand's force wanders during a stroke. Three strokes of one lump, at F / sqrt(1.4), F and F sqrt(1.4), hold
what the sensor model needs to interpolate any force between them, so every lump comes with all three. With
two alone the images between are off by seven times as much.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from math import exp, log, log10, sqrt
from typing import Any

import numpy as np
from scipy.stats import qmc

from palpate.learn.lumps import FORCE_STEP, LumpStrokes
from palpate.sim.tissue import Case, Settings, any_tissue, sobol_cases
from palpate.sim.tissue.any_tissue import FORCE_PARTS, REFERENCE_PARTS
from palpate.sim.tissue.design import USUAL, Ranges

FIELD_SETTINGS = Settings(far_start_mm=-44.0)
"""The usual steps of 2 mm, and a coarser approach so that a stroke may start 5 mm off."""
PRESS_SETTINGS = Settings(start_mm=-40.0, press_only=True)
PRESS_PARTS = REFERENCE_PARTS[:-1]
"""On the usual mesh, unlike `any_tissue`: told its tissue a model looks at a press in its checks alone."""

NO_LUMP_THICKNESS_MM = (4.0, 40.0)
RADIUS, STIFFENING = (1.05, 1.09), (1.0, 2.5)
"""By what factor the face's radius differs on other tissues, either way, and by how much more b the fat
stiffens."""

_OTHER_SEED = 41

OUTSIDE = Ranges((4.0, 25.0), (0.2, 2.0), (1.3, 1000.0), (0.2, 1.2))
"""Wider in every input than the model's ranges. Lumps in here and not in there, the rim, are trained on
too, so that an estimate beyond the ranges means a lump beyond them; others test the domain flag."""


def at_forces(case: Case) -> tuple[Case, Case, Case]:
    """The cases to simulate for one lump."""
    step = sqrt(FORCE_STEP)
    return replace(case, F_rel=case.F_rel / step), case, replace(case, F_rel=case.F_rel * step)


def lump_cases(
    n: int, seed: int = 1, ranges: Ranges = USUAL, tissue: dict[str, Any] | None = None
) -> list[Case]:
    """3 n cases: Sobol lumps over `ranges`; `tissue` changes fields of `Case`, as gland_ratio."""
    return [c for case in sobol_cases(n, seed, ranges) for c in at_forces(replace(case, **(tissue or {})))]


def rim_cases(n: int, seed: int = 3, tissue: dict[str, Any] | None = None) -> list[Case]:
    """3 n cases: lumps in `OUTSIDE` but not within the usual ranges."""
    drawn = sobol_cases(4 * n, seed, OUTSIDE)
    rim = [case for case in drawn if not inside(case)][:n]
    return [c for case in rim for c in at_forces(replace(case, **(tissue or {})))]


def inside(case: Case, ranges: Ranges = USUAL) -> bool:
    """Whether a lump lies in the ranges that the model is for, the probe being the usual one."""
    named = [f.name for f in fields(ranges) if getattr(ranges, f.name) is not None]
    return all(getattr(ranges, n)[0] <= getattr(case, n) <= getattr(ranges, n)[1] for n in named)


def no_lump_cases(n: int, seed: int = 2, tissue: dict[str, Any] | None = None) -> list[Case]:
    """3 n cases of plain tissue, its thickness even in its logarithm from 4 to 40 mm."""
    points = qmc.Sobol(2, seed=np.random.default_rng(seed)).random_base2(max(0, (n - 1).bit_length()))[:n]
    low, high = (log10(t) for t in NO_LUMP_THICKNESS_MM)
    out: list[Case] = []
    for u, v in points:
        F_low, F_high = USUAL.F_rel
        t_mm, F = 10 ** (low + (high - low) * u), F_low + (F_high - F_low) * v
        out += at_forces(Case.without_lump(t_mm, F, **(tissue or {})))
    return out


def press_cases(lumps: Sequence[LumpStrokes]) -> list[Case]:
    """What to simulate, with `PRESS_SETTINGS`, of the presses before these strokes."""
    # at their middle force; without rounding where that was simulated
    whole = len(FORCE_PARTS)
    middle = [lump.strokes[1].case if len(lump.strokes) == whole else lump.case for lump in lumps]
    return any_tissue.at_forces(middle, PRESS_PARTS)


def other_cases(n: int, tissue: Mapping[str, Any] | None = None, seed: int = _OTHER_SEED) -> list[Case]:
    """What to simulate, with `PRESS_SETTINGS`: `n` tissues at rising forces, each off in one thing.

    Its face's radius, or how its fat stiffens, in turn.

    Parameters
    ----------
    n : int
    tissue : mapping, optional
        What the model is told, fields of `Case`.
    """
    rng = np.random.default_rng(seed)
    out = []
    for k, lump in enumerate(sobol_cases(n, seed)):
        usual = Case.without_lump(lump.t_mm, lump.F_rel, **(tissue or {}))
        if k % 2:
            b = usual.fat_stiffening + float(rng.uniform(*STIFFENING))
            out.append(replace(usual, fat_stiffening=round(b, 3)))
        else:
            way, low, high = (1 if k % 4 else -1), log(RADIUS[0]), log(RADIUS[1])
            radius = usual.probe_radius_mm * exp(way * rng.uniform(low, high))
            out.append(replace(usual, probe_radius_mm=round(radius, 3)))
    return any_tissue.at_forces(out, REFERENCE_PARTS)
