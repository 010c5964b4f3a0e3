"""What the field model is trained and judged on: lumps over the whole range, each at three forces.

The hand's force wanders during a stroke. Three strokes of one lump, at F / sqrt(1.4), F and F sqrt(1.4), hold
what the sensor model needs to interpolate any force between them, so every lump comes with all three. With
two alone the images between are off by seven times as much.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from math import log10, sqrt
from typing import Any

import numpy as np
from scipy.stats import qmc

from palpate.sim.tissue import Case, Settings, Stroke, sobol_cases
from palpate.sim.tissue.design import USUAL, Ranges

FORCE_STEP = 1.4
FIELD_SETTINGS = Settings(far_start_mm=-44.0)
"""The usual steps of 2 mm, and a coarser approach so that a stroke may start 5 mm off."""

NO_LUMP_THICKNESS_MM = (4.0, 40.0)

OUTSIDE = Ranges((4.0, 25.0), (0.2, 2.0), (1.3, 1000.0), (0.2, 1.2))
"""Wider in every input than the model's ranges. Lumps in here and not in there, the rim, are trained on
too, so that an estimate beyond the ranges means a lump beyond them; others test the domain flag."""


@dataclass(frozen=True)
class LumpStrokes:
    """Strokes over one lump, or plain tissue, at rising forces; the greatest is 1.4 times the smallest.

    press: what is pressed before them, one position at rising forces; empty where nobody has simulated it.
    """

    strokes: tuple[Stroke, ...]
    press: tuple[Stroke, ...] = ()

    @property
    def low(self) -> Stroke:
        """That of the smallest force."""
        return self.strokes[0]

    @property
    def high(self) -> Stroke:
        """That of the greatest force."""
        return self.strokes[-1]

    @property
    def case(self) -> Case:
        """The lump, with the force midway between the smallest and the greatest (geometrically)."""
        return replace(self.low.case, F_rel=sqrt(self.low.case.F_rel * self.high.case.F_rel))


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


def by_lump(strokes: Iterable[Stroke]) -> tuple[list[LumpStrokes], list[str]]:
    """Strokes put together lump by lump; beside them the codes of those whose partners are missing.

    Strokes are partners if their cases differ in the force alone. A lump is whole if its greatest force is
    1.4 times its smallest: two are enough, as older sets have them.
    """
    found: dict[Case, list[Stroke]] = {}
    for stroke in strokes:
        found.setdefault(replace(stroke.case, F_rel=1.0), []).append(stroke)
    lumps, alone = [], []
    for partners in found.values():
        rising = sorted(partners, key=lambda s: s.case.F_rel)
        if abs(rising[-1].case.F_rel / rising[0].case.F_rel - FORCE_STEP) < 1e-6:
            lumps.append(LumpStrokes(tuple(rising)))
        else:
            alone += [stroke.code for stroke in rising]
    return lumps, alone
