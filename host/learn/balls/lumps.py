"""Kept strokes over balls and ellipsoids, lump by lump, each with its press. Units: mm, kPa, N/m."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np

from palpate.errors import UsageError
from palpate.learn.any_tissue.observed import TissueLump
from palpate.learn.field.design import LumpStrokes, by_lump
from palpate.sim.tissue import Stroke
from palpate.sim.tissue.solid.kept import KeptStroke, read_kept
from palpate.sim.tissue.solid.press import felt, press_before

SET, RIM_SET = "balls.parquet", "balls-rim.parquet"


def holds_balls(directory: Path) -> bool:
    """Whether a kept set of solid lumps lies there."""
    return (directory / SET).exists()


def read_lumps(directory: Path) -> list[TissueLump]:
    """The lumps of DIRECTORY/balls.parquet, which `palpate sweep --design balls:N --keep` writes."""
    if not holds_balls(directory):
        raise UsageError(
            f"{directory} holds no {SET}; palpate sweep --design balls:100 --out {directory} "
            f"--keep {directory / SET} makes one, half a minute a lump"
        )
    return solid_lumps(read_kept(directory / SET))


def read_rim(directory: Path) -> list[TissueLump]:
    """The lumps outside the ranges in DIRECTORY/balls-rim.parquet, to test flags; none if it is not there."""
    path = directory / RIM_SET
    return solid_lumps(read_kept(path)) if path.exists() else []


def without_lump(lump: TissueLump) -> TissueLump:
    """Strokes over the same tissue where it is plain: all along they feel what they feel where they begin.

    The images are made alike fore and aft: what is left in them of a large lump ahead would else turn round
    in the middle of the stroke, which is a bump.
    """
    plain = []
    for stroke in lump.strokes.strokes:
        n = len(stroke.positions_mm)
        first = (stroke.images_kPa[:1] + stroke.images_kPa[:1, ::-1]) / 2
        image, depth = np.repeat(first, n, axis=0), np.repeat(stroke.displacement_mm[:1], n)
        plain.append(felt(stroke.case, stroke.positions_mm, depth, image))
    return TissueLump(LumpStrokes(tuple(plain)), lump.press)


def solid_lumps(kept: Sequence[KeptStroke]) -> list[TissueLump]:
    """Lumps that have all their forces; `UsageError` where no lump has."""
    out = []
    for _, partners in groupby(kept, key=lambda k: replace(k.case, F_rel=1.0)):
        rising = sorted(partners, key=lambda k: k.case.F_rel)
        lumps, _ = by_lump([felt(k.case, k.positions_mm, k.displacement_mm, k.images_kPa) for k in rising])
        out += [TissueLump(lump, press_before(rising)) for lump in lumps]
    if not out:
        raise UsageError("the set holds no lump at three forces")
    return out


def beside(stroke: Stroke) -> Stroke:
    """The same stroke with the lump on the other side of the line."""
    case = replace(stroke.case, offset_mm=-stroke.case.offset_mm)
    return replace(stroke, case=case, images_kPa=stroke.images_kPa[:, :, ::-1])
