"""Solid lumps as the probe sees them: the stroke's features in integers, its columns, and its press."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from firmware_py import features as firmware_features
from firmware_py import geometry, status
from palpate.features.map_features import Floats
from palpate.features.press_features import ABSENT
from palpate.firmware_twin.replay_core import Replay
from palpate.regression.any_tissue.observed import random_scale
from palpate.regression.balls.across import across
from palpate.regression.balls.lumps import SolidLump, beside, scaled
from palpate.regression.observed import NAMES, noise_named
from palpate.regression.probe_model import shows_lump
from palpate.sim.probe.sensors import PRESS_FRAMES, Noise, SensorModel, StrokeField
from palpate.sim.tissue import Case

TRUTH = (
    "ln d", "ln width", "ln depth", "ln t", "E^-2/3", "ln F/E_fat", "ln F", "ln E_fat", "offset",
    "gland_ratio", "gland_mm",
)  # fmt: skip
_OF_THE_PRESS = slice(firmware_features.PRESS, firmware_features.PRESS + 9)


@dataclass(frozen=True)
class ObservedBalls:
    """n strokes with a press each.

    Attributes
    ----------
    X : (n, features)
        The stroke's, by the firmware's names.
    side : (n, 4)
        Across the stroke: ln width, distance from the line (mm), share, and the share of columns in use.
    press : (n, 9)
        Those of X that tell of the press.
    Y : (n, 11)
        By `TRUTH`; lengths in mm, F in N/m, E_fat in kPa, offset in mm to either side.
    found : (n), bool
        Whether the stroke is whole and shows a lump.
    group : (n), int
        Which lump.
    place_mm : (n)
        Where the bump lies across the stroke, with its sign.
    """

    X: Floats
    side: Floats
    press: Floats
    Y: Floats
    found: NDArray[np.bool_]
    group: NDArray[np.int64]
    place_mm: Floats

    def take(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> ObservedBalls:
        """Some of the strokes: a mask (n), or indices."""
        return ObservedBalls(*(getattr(self, f.name)[rows] for f in fields(self)))

    def truth(self, name: str) -> Floats:
        """One of `TRUTH`, (n,)."""
        return self.Y[:, TRUTH.index(name)]


def observe(
    lumps: Sequence[SolidLump], noise: Noise | str, seed: int, force_map: bytes | None
) -> ObservedBalls:
    """One stroke with its press over each lump, each in a fat and by a probe and a hand of its own.

    A stroke so light that the probe saw too little of its press is left out.
    """
    level, replay = noise_named(noise), Replay(force_map)
    rows = [_one(lump, level, np.random.default_rng([seed, k]), replay) for k, lump in enumerate(lumps)]
    X, side, Y, whole, place = (np.array(part) for part in zip(*rows, strict=True))
    found = whole & shows_lump(X, NAMES)
    seen = ObservedBalls(X, side, X[:, _OF_THE_PRESS], Y, found, np.arange(len(lumps)), place)
    return seen.take(seen.press[:, 0] != ABSENT)


def _one(
    lump: SolidLump, level: Noise, rng: np.random.Generator, replay: Replay
) -> tuple[Floats, Floats, list[float], bool, float]:
    """Features, what lies across, truth, whether the stroke is whole, and its bump's place across."""
    s, turned = random_scale(lump.case, rng), rng.random() < 0.5
    field, pressed = (
        StrokeField(*(scaled(beside(stroke) if turned else stroke, s) for stroke in some))
        for some in (lump.strokes.strokes, lump.press)
    )
    sensors = SensorModel(field, level, int(rng.integers(1 << 40)))
    stream = sensors.stroke(press=PRESS_FRAMES, pressed=pressed)
    code = replay.stream(stream, sensors.calibration())
    pipeline = replay.pipeline
    seen = across(np.array(pipeline.columns))
    used = (pipeline.span[1] - pipeline.span[0]) / geometry.COLUMNS
    side = np.array([np.log(seen.width_mm), abs(seen.place_mm), seen.share, used])
    truth = _truth(lump.case, stream.truth.F_N_per_m, s * lump.case.fat_kPa)
    # told as if the lump had not been turned, so that a place on the wrong side is an error
    sign = -1.0 if turned else 1.0
    return replay.features(), side, truth, code == status.OK, sign * seen.place_mm


def _truth(case: Case, F: float, fat_kPa: float) -> list[float]:
    """By `TRUTH`."""
    lengths = np.log([case.d_mm, 2 * case.half_axes_mm[1], case.depth_mm, case.t_mm])
    ratios = np.log([F / fat_kPa, F, fat_kPa])
    return [*lengths, case.E_inv23, *ratios, abs(case.offset_mm), case.gland_ratio, case.gland_mm]


def joined(parts: Sequence[ObservedBalls]) -> ObservedBalls:
    """Several sets as one."""
    return ObservedBalls(
        *(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(ObservedBalls))
    )
