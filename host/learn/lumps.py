"""Strokes over one lump at rising forces with the press before them, from sweeps and from kept sets.

Units: mm, kPa, N/m.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from itertools import groupby
from math import sqrt
from pathlib import Path

import numpy as np

from palpate.errors import UsageError
from palpate.sim.probe.sensors import StrokeField
from palpate.sim.tissue import Case, Stroke, load_strokes, read_table
from palpate.sim.tissue.solid.kept import KeptStroke, read_kept
from palpate.sim.tissue.solid.press import felt, press_before

FORCE_STEP = 1.4
TISSUE_FIELDS = tuple(f.name for f in fields(Case) if f.name not in ("d_mm", "h", "E_ratio", "F_rel"))
"""What a case says of tissue and probe: all but the lump and the force."""
SET, RIM_SET = "balls.parquet", "balls-rim.parquet"


@dataclass(frozen=True)
class LumpStrokes:
    """Strokes over one lump, or plain tissue, at rising forces; the greatest is 1.4 times the smallest.

    press: what is pressed before them, one position at rising forces; empty where nobody has simulated it.
    """

    strokes: tuple[Stroke, ...]
    press: tuple[Stroke, ...] = ()

    @property
    def low(self) -> Stroke:
        """The stroke of the smallest force."""
        return self.strokes[0]

    @property
    def high(self) -> Stroke:
        """The stroke of the greatest force."""
        return self.strokes[-1]

    @property
    def case(self) -> Case:
        """The lump, with the force midway between the smallest and the greatest (geometrically)."""
        return replace(self.low.case, F_rel=sqrt(self.low.case.F_rel * self.high.case.F_rel))

    @property
    def field(self) -> StrokeField:
        """What the sensors feel."""
        return StrokeField(*self.strokes)

    def scaled(self, s: float) -> LumpStrokes:
        """The same lump with all moduli and the force times s."""
        return LumpStrokes(*(tuple(scaled(one, s) for one in part) for part in (self.strokes, self.press)))

    def mirrored(self) -> LumpStrokes:
        """The lump on the other side of the line."""
        return LumpStrokes(*(tuple(map(beside, part)) for part in (self.strokes, self.press)))


def scaled(stroke: Stroke, s: float) -> Stroke:
    """A stroke with all moduli and the force times s."""
    case = replace(stroke.case, fat_kPa=stroke.case.fat_kPa * s, F_rel=stroke.case.F_rel * s)
    return replace(stroke, case=case, images_kPa=stroke.images_kPa * s, peak_kPa=stroke.peak_kPa * s)


def beside(stroke: Stroke) -> Stroke:
    """A stroke with the lump on the other side of the line."""
    case = replace(stroke.case, offset_mm=-stroke.case.offset_mm)
    return replace(stroke, case=case, images_kPa=stroke.images_kPa[:, :, ::-1])


def by_lump(strokes: Iterable[Stroke]) -> tuple[list[LumpStrokes], list[str]]:
    """Strokes put together lump by lump; beside them the codes of those whose partners are missing.

    Strokes are partners if their cases differ in the force alone. A lump is whole if its greatest force is
    1.4 times its smallest: two are enough, as older sets have them.
    """
    lumps, alone = [], []
    for rising in _rising(strokes):
        if abs(rising[-1].case.F_rel / rising[0].case.F_rel - FORCE_STEP) < 1e-6:
            lumps.append(LumpStrokes(rising))
        else:
            alone += [stroke.code for stroke in rising]
    return lumps, alone


def read_lumps(home: Path) -> tuple[list[LumpStrokes], int, int]:
    """Lumps of a sweep's directory, how many strokes failed, and how many have no partner."""
    failed = int((read_table(home)["status"] != "ok").sum())
    lumps, alone = by_lump(load_strokes(home))
    return lumps, failed, len(alone)


def read_presses(home: Path) -> list[tuple[Stroke, ...]]:
    """The presses of a sweep (designs `any-press`, `anywhere-press`), lump by lump, at rising forces."""
    return [press for press in _rising(load_strokes(home)) if len(press) > 2]


def read_pressed(strokes: Path, presses: Path) -> list[LumpStrokes]:
    """The lumps of two sweeps, designs `any` and `any-press`, that both have whole."""
    found = {_key(press[0].case): press for press in read_presses(presses)}
    lumps = read_lumps(strokes)[0]
    out = [replace(lump, press=found[key]) for lump in lumps if (key := _key(lump.low.case)) in found]
    if not out:
        raise UsageError(f"{strokes} and {presses} have no lump in common")
    return out


def _rising(strokes: Iterable[Stroke]) -> list[tuple[Stroke, ...]]:
    """Strokes whose cases differ in the force alone, by rising force."""
    found: dict[Case, list[Stroke]] = {}
    for stroke in strokes:
        found.setdefault(_key(stroke.case), []).append(stroke)
    return [tuple(sorted(partners, key=lambda s: s.case.F_rel)) for partners in found.values()]


def _key(case: Case) -> Case:
    return replace(case, F_rel=1.0)


def holds_solids(directory: Path) -> bool:
    """Whether a kept set of solid lumps lies there."""
    return (directory / SET).exists()


def read_solids(directory: Path) -> list[LumpStrokes]:
    """The lumps of DIRECTORY/balls.parquet, which `palpate sweep --design balls:N --keep` writes."""
    if not holds_solids(directory):
        raise UsageError(
            f"{directory} holds no {SET}; palpate sweep --design balls:100 --out {directory} "
            f"--keep {directory / SET} makes one, half a minute a lump"
        )
    return solid_lumps(read_kept(directory / SET))


def read_solid_rim(directory: Path) -> list[LumpStrokes]:
    """The lumps outside the ranges in DIRECTORY/balls-rim.parquet, to test flags; none if it is not there."""
    path = directory / RIM_SET
    return solid_lumps(read_kept(path)) if path.exists() else []


def solid_lumps(kept: Sequence[KeptStroke]) -> list[LumpStrokes]:
    """Lumps that have all their forces; `UsageError` where no lump has."""
    out = []
    for _, partners in groupby(kept, key=lambda k: _key(k.case)):
        rising = sorted(partners, key=lambda k: k.case.F_rel)
        lumps, _ = by_lump([felt(k.case, k.positions_mm, k.displacement_mm, k.images_kPa) for k in rising])
        out += [replace(lump, press=press_before(rising)) for lump in lumps]
    if not out:
        raise UsageError("the set holds no lump at three forces")
    return out


def without_lump(lump: LumpStrokes) -> LumpStrokes:
    """Strokes over plain tissue: all along, a solid lump's strokes feel what they feel where they begin.

    The images are made alike fore and aft: what is left in them of a large lump ahead would else turn round
    in the middle of the stroke, which is a bump.
    """
    plain = []
    for stroke in lump.strokes:
        n = len(stroke.positions_mm)
        first = (stroke.images_kPa[:1] + stroke.images_kPa[:1, ::-1]) / 2
        image, depth = np.repeat(first, n, axis=0), np.repeat(stroke.displacement_mm[:1], n)
        plain.append(felt(stroke.case, stroke.positions_mm, depth, image))
    return replace(lump, strokes=tuple(plain))
