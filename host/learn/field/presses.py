"""The presses before a told model's strokes, and presses on tissues that are not the one it is told.

The press depends on what lies under the skin alone, so the other tissues need no lump and no stroke: the
probe stands on one place. Another fat needs no simulation at all (`strange`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, log
from pathlib import Path
from typing import Any

import numpy as np

from palpate.learn.field.design import LumpStrokes
from palpate.sim.probe.sensors import StrokeField
from palpate.sim.tissue import Case, Stroke, load_strokes, sobol_cases
from palpate.sim.tissue.any_tissue import FORCE_PARTS, PRESS_PARTS, REFERENCE_PARTS, at_forces

FEWEST_LUMPS = 200
"""To train on; a model of fewer has no checks, which would not tell strange strokes from its own, and needs
no presses."""

OTHER = "other-press"
"""The part of a directory with presses on other tissues."""

RADIUS, STIFFENING = (1.05, 1.09), (1.0, 2.5)
"""By what factor the face's radius differs there, either way, and by how much more b the fat stiffens."""

_SEED = 41


@dataclass(frozen=True)
class OtherTissue:
    """A press on it at rising forces, and a stroke along it without a lump.

    kind: the field of `Case` that differs; off: by how much, of lengths as a difference of logarithms
    """

    kind: str
    off: float
    press: tuple[Stroke, ...]

    @property
    def field(self) -> StrokeField:
        """What the sensors feel."""
        return StrokeField(*self.press[-3:], press=self.press)


def read_presses(home: Path) -> list[tuple[Stroke, ...]]:
    """The presses of a sweep (`press_cases`, or of design `any-press`), lump by lump, at rising forces."""
    by_lump: dict[object, list[Stroke]] = {}
    for stroke in load_strokes(home):
        by_lump.setdefault(_key(stroke.case), []).append(stroke)
    rising = (tuple(sorted(press, key=lambda s: s.case.F_rel)) for press in by_lump.values())
    return [press for press in rising if len(press) > 2]


def press_cases(lumps: Sequence[LumpStrokes]) -> list[Case]:
    """What to simulate, with `PRESSES`, of the presses before these strokes."""
    return at_forces([_middle(lump) for lump in lumps], PRESS_PARTS)


def with_presses(lumps: Sequence[LumpStrokes], home: Path) -> list[LumpStrokes]:
    """The lumps with the presses that `home` holds; without, where it holds none."""
    if not (home / "strokes.parquet").exists():
        return list(lumps)
    found = {_key(press[0].case): press for press in read_presses(home)}
    return [replace(lump, press=found.get(_key(lump.low.case), ())) for lump in lumps]


def other_cases(n: int, tissue: Mapping[str, Any] | None = None, seed: int = _SEED) -> list[Case]:
    """What to simulate, with `PRESSES`: `n` tissues at rising forces, each off in one thing.

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
    return at_forces(out, REFERENCE_PARTS)


def read_others(home: Path, tissue: Mapping[str, Any] | None = None) -> list[OtherTissue]:
    """The other tissues that `home` holds, none where it holds nothing; tissue as for `other_cases`."""
    if not (home / "strokes.parquet").exists():
        return []
    usual = Case.without_lump(10.0, **(tissue or {}))
    out = []
    for press in read_presses(home):
        radius = log(press[0].case.probe_radius_mm / usual.probe_radius_mm)
        stiffening = press[0].case.fat_stiffening - usual.fat_stiffening
        kind, off = ("probe_radius_mm", radius) if radius else ("fat_stiffening", stiffening)
        out.append(OtherTissue(kind, off, press))
    return out


def _middle(lump: LumpStrokes) -> Case:
    """The lump at its middle force; without rounding where that was simulated."""
    return lump.strokes[1].case if len(lump.strokes) == len(FORCE_PARTS) else lump.case


def _key(case: Case) -> Case:
    return replace(case, F_rel=1.0)
