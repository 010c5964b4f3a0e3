"""The bundled models where people are: at the ends of their ranges and beyond, on lumps nobody has seen.

Every stroke is felt by a probe of that noise after its press, and the model answers as its image does. Each
row has lumps of its own; what it simulates is kept nowhere, since it takes minutes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate import models
from palpate.learn.lumps import LumpStrokes, holds_solids, read_solid_rim
from palpate.learn.observed import observe_in_any_fat
from palpate.model_export.integers import force_map
from palpate.model_export.integers.reference import evaluate, inputs
from palpate.models.build import simulated
from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.any_tissue import (
    FORCE_PARTS,
    TissueRanges,
    random_lumps,
    rim_lumps,
)
from palpate.sim.tissue.anywhere import anywhere_lumps, anywhere_rim
from palpate.sim.tissue.solid.design import SolidRanges, ball_cases
from palpate.sim.tissue.solid.press import press_before
from palpate.sim.tissue.solid.stroke import simulate_forces as simulate_solid
from palpate.wire.events import OUTPUTS
from tests.studies.table import Asked, StudyTable, of_text

LUMPS, SEED = 40, 5100
ONE_MATERIAL_MM = 35.0
"""Thickness of the phantom of one material of Egorov and Sarvazyan's."""


@dataclass(frozen=True)
class Row:
    """Lumps and the moduli of their fat, kPa, for one model."""

    words: str
    model: str
    lumps: Callable[[int], list[Case]]
    fat_kPa: tuple[float, float] = (5.0, 25.0)


def _of_ratio(ratio: float) -> Callable[[int], list[Case]]:
    ranges = replace(TissueRanges(), gland_ratio=(ratio, ratio))
    return lambda n: random_lumps(n, SEED, ranges)


def _hard_pressed(n: int) -> list[Case]:
    """The thesis' own tissue, pressed as hard as the thesis does and harder."""
    ranges = replace(TissueRanges(), reach_mm=(9.0, 12.0), gland_ratio=(6.0, 6.0), linear=1.0)
    return random_lumps(n, SEED, ranges)


def _one_material(n: int) -> list[Case]:
    """No gland: what lies under the lump is fat too."""
    return [
        replace(case, gland_ratio=1.0, gland_stiffening=case.fat_stiffening, gland_mm=ONE_MATERIAL_MM - t)
        for case in anywhere_lumps(4 * n, SEED)
        if (t := case.t_mm) < ONE_MATERIAL_MM - 8.0 and case.depth_mm + case.d_mm < ONE_MATERIAL_MM - 1.0
    ][:n]


ROWS = (
    Row("inside the ranges", models.FIELD, lambda n: random_lumps(n, SEED, TissueRanges())),
    Row("gland as stiff as fat", models.FIELD, _of_ratio(1.0)),
    Row("gland 1.3 times as stiff", models.FIELD, _of_ratio(1.3)),
    Row("fat of 3 kPa", models.FIELD, lambda n: random_lumps(n, SEED + 1, TissueRanges()), (3.0, 3.0)),
    Row("fat of 35 kPa", models.FIELD, lambda n: random_lumps(n, SEED + 1, TissueRanges()), (35.0, 35.0)),
    Row("the thesis' tissue, F/E_fat 9 to 12 mm", models.FIELD, _hard_pressed, (10.0, 10.0)),
    Row("lumps outside the ranges", models.FIELD, lambda n: rim_lumps(n, SEED)),
    Row("inside the ranges", models.ANYWHERE, lambda n: anywhere_lumps(n, SEED)),
    Row(f"one material, {ONE_MATERIAL_MM:g} mm thick", models.ANYWHERE, _one_material),
    Row("lumps outside the ranges", models.ANYWHERE, lambda n: anywhere_rim(n, SEED)),
)


@dataclass(frozen=True)
class SolidRow:
    """Lumps on the line for `balls`, and the mesh of their strokes."""

    words: str
    gland_ratio: tuple[float, float]
    settings: Settings


SOLID_ROWS = (
    SolidRow("inside the ranges, columns of 1 mm", SolidRanges().gland_ratio, Settings(hx_mm=1.0)),
    SolidRow("gland as stiff as fat", (1.0, 1.0), Settings()),
)
SOLID_LUMPS, SOLID_NOISES = 9, 8
"""A lump takes half a minute, or a whole one: each is felt several times."""
HEADS = ["model", "lumps", "strokes", "found", "flagged", "d %", "depth %", "t %", "E_fat %", "held, %"]


def tables(asked: Asked) -> list[StudyTable]:
    """A row for each of `ROWS` and `SOLID_ROWS`, and for kept solid lumps outside the ranges where DIRECTORY
    has them."""
    n, noise = asked.lumps or LUMPS, asked.noise or "typical"
    found = []
    for k, row in enumerate(ROWS):
        lumps = [simulated(case) for case in row.lumps(n)]
        found.append([row.model, row.words, *_judged(row.model, lumps, row.fat_kPa, noise, asked.seed + k)])
        asked.tell(" | ".join(found[-1]))
    for solid in SOLID_ROWS:
        lumps = _solids(solid, asked.lumps or SOLID_LUMPS) * SOLID_NOISES
        found.append(
            [models.BALLS, solid.words, *_judged(models.BALLS, lumps, (5.0, 25.0), noise, asked.seed)]
        )
        asked.tell(" | ".join(found[-1]))
    if holds_solids(asked.directory):
        rim = read_solid_rim(asked.directory)
        cells = _judged(models.BALLS, rim, (5.0, 25.0), noise, asked.seed)
        found.append([models.BALLS, "lumps outside the ranges", *cells])
    return [of_text("Models at the ends of their ranges and beyond", HEADS, found)]


def _solids(row: SolidRow, n: int) -> list[LumpStrokes]:
    ranges = replace(SolidRanges(), on_line=1.0, gland_ratio=row.gland_ratio)
    cases, out = ball_cases(n, SEED, ranges), []
    for first in range(0, len(cases), len(FORCE_PARTS)):
        rising = cases[first : first + len(FORCE_PARTS)]
        found = simulate_solid(rising[0], [case.F_rel for case in rising], row.settings, ramp=True)
        strokes = tuple(replace(stroke, case=case) for stroke, case in zip(found, rising, strict=True))
        out.append(LumpStrokes(strokes, press_before(strokes)))
    return out


def _judged(
    model: str, lumps: Sequence[LumpStrokes], fat_kPa: tuple[float, float], noise: str, seed: int
) -> list[str]:
    """Cells of a row: strokes, found, flagged; of what is found median errors, and the share held by 90 %
    intervals in d, depth, t and E_fat."""
    spec = models.load(model)
    blob = b"" if spec.force_map is None else force_map.blob(spec.force_map)
    low, high = np.log(fat_kPa)
    fats = np.exp(np.random.default_rng(seed).uniform(low, high, len(lumps)))
    seen = observe_in_any_fat(lumps, noise, seed, blob, fat_kPa=fats.tolist())
    strokes, shown = len(seen.found), float(seen.found.mean())
    seen = seen.take(seen.found)
    said = evaluate(spec, inputs(spec, seen.X))
    cells = [str(strokes), f"{shown:.0%}", f"{(~np.asarray(said['in_domain'])).mean():.0%}"]
    held = []
    d, h, t, fat = (OUTPUTS.index(name) for name in ("d_mm", "h", "t_mm", "E_fat_kPa"))
    for j in (d, h, t, fat):
        true = seen.values[:, j]
        value, below, above = (np.asarray(said[part])[:, j] for part in ("value", "low", "high"))
        held.append(((below <= true) & (true <= above)).mean())
        if j == h:  # told as depth over width; what is meant is the depth
            value, true = value * np.asarray(said["value"])[:, d], np.exp(seen.of("ln depth"))
        cells.append(f"{100 * np.median(np.abs(value / true - 1)):.1f}")
    return [*cells, " ".join(f"{100 * share:.0f}" for share in held)]
