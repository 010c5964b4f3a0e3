"""Lumps in random tissue as the probe sees them: the stroke's features in integers, and its press.

One simulation serves every fat: with all moduli and the force times s, displacements stay and pressures go
times s. So each stroke gets a fat of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import UsageError
from palpate.features import press_features
from palpate.features.map_features import Floats
from palpate.firmware_twin.replay_core import Replay
from palpate.learn.field.data import read_lumps
from palpate.learn.field.design import LumpStrokes
from palpate.learn.field.presses import read_presses
from palpate.learn.observed import NAMES, noise_named
from palpate.learn.probe_model import shows_lump
from palpate.model_export.vocabulary import ABSENT
from palpate.sim.probe.sensors import PRESS_FRAMES, Noise, SensorModel, StrokeField
from palpate.sim.probe.two_lumps import random_pair
from palpate.sim.tissue import Case, Stroke

FAT_KPA = (2.0, 40.0)
FORCE_N_PER_M = (15.0, 250.0)
USUAL_FAT_KPA, USUAL_FORCE_N_PER_M, USUAL_SHARE = (5.0, 25.0), (25.0, 150.0), 0.6
USUAL_RATIO, USUAL_REACH_MM = 2.0, 10.7
"""Gland over fat at least; the stroke's force over the fat's modulus at most."""
TRUTH = ("ln d", "ln depth", "ln t", "E^-2/3", "ln F/E_fat", "ln F", "ln E_fat", "gland_ratio", "gland_mm")


@dataclass(frozen=True)
class TissueLump:
    """Strokes over one lump at several forces, and the press before them; fat of the simulations' modulus."""

    strokes: LumpStrokes
    press: tuple[Stroke, ...]


@dataclass(frozen=True)
class ObservedInTissue:
    """n strokes with a press each.

    Attributes
    ----------
    X : (n, features)
        The stroke's, by the firmware's names.
    press : (n, 12)
        Those of X that tell of the press, by `press_features.NAMES`.
    Y : (n, 9)
        By `TRUTH`; lengths in mm, F in N/m, E_fat in kPa.
    found : (n), bool
        Whether the stroke is whole and shows a lump.
    group : (n), int
        Which lump.
    columns : (n, columns)
        How much of the bump each column sees (`firmware_py.columns`).
    across : (n, 2)
        Of solid lumps: ln of the width across the stroke, mm, and the distance from its line, mm.
    """

    X: Floats
    press: Floats
    Y: Floats
    found: NDArray[np.bool_]
    group: NDArray[np.int64]
    columns: Floats
    across: Floats

    def take(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> ObservedInTissue:
        """Some of the strokes: a mask (n), or indices."""
        return ObservedInTissue(*(getattr(self, f.name)[rows] for f in fields(self)))


def read_set(strokes: Path, presses: Path) -> list[TissueLump]:
    """The lumps of two sweeps, designs `any` and `any-press`, that both have whole."""
    by_lump = {replace(press[0].case, F_rel=1.0): press for press in read_presses(presses)}
    out = []
    for lump in read_lumps(strokes)[0]:
        if (press := by_lump.get(replace(lump.case, F_rel=1.0))) is not None:
            out.append(TissueLump(lump, press))
    if not out:
        raise UsageError(f"{strokes} and {presses} have no lump in common")
    return out


def scaled(stroke: Stroke, s: float) -> Stroke:
    """The same stroke with all moduli and the force times s."""
    case = replace(stroke.case, fat_kPa=stroke.case.fat_kPa * s, F_rel=stroke.case.F_rel * s)
    return replace(stroke, case=case, images_kPa=stroke.images_kPa * s, peak_kPa=stroke.peak_kPa * s)


def random_scale(case: Case, rng: np.random.Generator) -> float:
    """A fat modulus in `FAT_KPA`, over the case's own, that keeps the force in `FORCE_N_PER_M`.

    Three in five lie within `USUAL_FAT_KPA` and `USUAL_FORCE_N_PER_M`, and all over a solid lump: `balls` is
    for those.
    """
    reach = case.F_N_per_m / case.fat_kPa
    fat, force = USUAL_FAT_KPA, USUAL_FORCE_N_PER_M
    if not case.solid and rng.random() >= USUAL_SHARE:
        fat, force = FAT_KPA, FORCE_N_PER_M
    low, high = max(fat[0], force[0] / reach), min(fat[1], force[1] / reach)
    return float(low * (high / low) ** rng.random() / case.fat_kPa)


def in_usual_tissue(seen: ObservedInTissue) -> NDArray[np.bool_]:
    """Which strokes are over tissue as most breasts have it, pressed as most hands press, (n)."""
    of = {name: seen.Y[:, k] for k, name in enumerate(TRUTH)}
    fat, force, reach = (np.exp(of[name]) for name in ("ln E_fat", "ln F", "ln F/E_fat"))
    within = (of["gland_ratio"] >= USUAL_RATIO) & (reach <= USUAL_REACH_MM)
    for value, (low, high) in ((fat, USUAL_FAT_KPA), (force, USUAL_FORCE_N_PER_M)):
        within &= (low <= value) & (value <= high)
    return within


def observe(
    lumps: Sequence[TissueLump],
    noise: Noise | str,
    seed: int,
    force_map: bytes | None,
    every: int = 1,
    first: int = 0,
    two_apart_mm: tuple[float, float] | None = None,
) -> ObservedInTissue:
    """One stroke with its press over each lump, each in a fat and by a probe and a hand of its own.

    A stroke so light that the probe saw too little of its press is left out: it has none to learn from, and
    is outside every domain.

    Parameters
    ----------
    every : int
        Use each `every`-th of the lump's forces only.
    first : int
        The number of the first lump, if these are part of a longer set.
    two_apart_mm : (float, float), optional
        Two lumps of a kind instead of one, so far apart (`sim.probe.two_lumps.random_pair`).
    """
    kept = [replace(lump, strokes=LumpStrokes(lump.strokes.strokes[::every])) for lump in lumps]
    return observe_at(kept, None, noise, seed, force_map, first, two_apart_mm)


def observe_at(
    lumps: Sequence[TissueLump],
    fat_kPa: Sequence[float] | None,
    noise: Noise | str,
    seed: int,
    force_map: bytes | None,
    first: int = 0,
    two_apart_mm: tuple[float, float] | None = None,
) -> ObservedInTissue:
    """The same in fat of these moduli, one for each lump; None: at random, as `random_scale` draws them."""
    level, replay = noise_named(noise), Replay(force_map)
    X, press, Y, whole, columns, across = [], [], [], [], [], []
    for k, lump in enumerate(lumps):
        rng = np.random.default_rng([seed, first + k])
        s = random_scale(lump.strokes.case, rng)
        if fat_kPa is not None:
            s = fat_kPa[k] / lump.strokes.case.fat_kPa
        strokes = [scaled(stroke, s) for stroke in lump.strokes.strokes]
        field = _field(strokes, two_apart_mm, (seed, first + k, 1))
        sensors = SensorModel(field, level, int(rng.integers(1 << 40)))
        pressed = StrokeField(*(scaled(p, s) for p in lump.press))
        stream = sensors.stroke(press=PRESS_FRAMES, pressed=pressed)
        code = replay.stream(stream, sensors.calibration())
        X.append(replay.features())
        press.append(X[-1][press_features.PLACES])
        case = lump.strokes.case
        Y.append(_truth(case, stream.truth.F_N_per_m, s * case.fat_kPa * stream.truth.stiffness))
        whole.append(code == 0)
        columns.append(np.array(replay.pipeline.columns, float))
        across.append([np.log(2 * case.half_axes_mm[1]), case.offset_mm])
    found = np.array(whole) & shows_lump(np.array(X), NAMES)
    group = first + np.arange(len(lumps))
    rest = found, group, np.array(columns), np.array(across)
    seen = ObservedInTissue(np.array(X), np.array(press), np.array(Y), *rest)
    return seen.take(seen.press[:, 0] != ABSENT)


def _field(
    strokes: Sequence[Stroke], two_apart_mm: tuple[float, float] | None, seed: tuple[int, ...]
) -> StrokeField:
    if two_apart_mm is None:
        return StrokeField(*strokes)
    return random_pair(strokes, two_apart_mm, np.random.default_rng(seed))


def _truth(case: Case, F: float, fat_kPa: float) -> list[float]:
    """By `TRUTH`."""
    lengths = np.log([case.d_mm, case.depth_mm, case.t_mm])
    ratios = np.log([F / fat_kPa, F, fat_kPa])
    return [*lengths, case.E_inv23, *ratios, case.gland_ratio, case.gland_mm]


def joined(parts: Sequence[ObservedInTissue]) -> ObservedInTissue:
    """Several sets as one."""
    names = [f.name for f in fields(ObservedInTissue)]
    return ObservedInTissue(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))
