"""Strokes as the probe observes them: quantised noisy frames through the firmware's own integer pipeline.

A lump is observed in the fat that it was simulated in (`observe`), or after a press, each in a fat of its own
(`observe_in_any_fat`): one simulation serves every fat, since with all moduli and the force times s
displacements stay and pressures go times s.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import feature_names, outputs, status
from firmware_py.calib import Calibration
from palpate.features import press_features
from palpate.features.map_features import Floats
from palpate.firmware_twin.replay_core import Replay
from palpate.learn.lumps import LumpStrokes
from palpate.learn.probe_model import OUTPUTS, from_link, shows_lump, to_link
from palpate.model_export.vocabulary import ABSENT
from palpate.sim.probe.noise import level_named
from palpate.sim.probe.packed_frames import FrameStream, Truth
from palpate.sim.probe.sensors import PRESS_FRAMES, Noise, SensorModel, StrokeField, pack
from palpate.sim.probe.two_lumps import random_pair
from palpate.sim.tissue import Case

NAMES = feature_names.NAMES
OF_THE_DISPLACEMENT = tuple(
    name for name in NAMES if name.startswith(("ln_d28", "ln_d0", "ln_d_far", "dip_", "press_d_"))
)
"""Features that a recording without displacement does not have."""
FAT_KPA = (2.0, 40.0)
FORCE_N_PER_M = (15.0, 250.0)
USUAL_FAT_KPA, USUAL_FORCE_N_PER_M, USUAL_SHARE = (5.0, 25.0), (25.0, 150.0), 0.6
USUAL_RATIO, USUAL_REACH_MM = 2.0, 10.7
"""Gland over fat at least; the stroke's force over the fat's modulus at most."""
TISSUE = ("ln depth", "ln F/E_fat", "gland_ratio", "gland_mm")
"""What else is true of a stroke beside the outputs; lengths in mm, F in N/m, E_fat in kPa."""
Alter = Callable[[NDArray[np.uint16]], NDArray[np.uint16]]


@dataclass(frozen=True)
class Observed:
    """n strokes as features with their truth.

    Attributes
    ----------
    X : (n, features)
        Every feature of the firmware, by `feature_names.NAMES`.
    truth : (n, outputs)
        Link scale, by `probe_model.OUTPUTS`; F is the mean force that the hand kept.
    tissue : (n, 4)
        By `TISSUE`.
    whole : (n), bool
        Whether the features are valid: the stroke covers the lump.
    found : (n), bool
        Whether the stroke is whole and shows a lump.
    group : (n), int
        Which lump: strokes of one lump share it.
    columns : (n, columns)
        How much of the bump each column sees (`firmware_py.columns`).
    across : (n, 2)
        Of solid lumps: ln of the width across the stroke, mm, and the distance from its line, mm.
    """

    X: Floats
    truth: Floats
    tissue: Floats
    whole: NDArray[np.bool_]
    found: NDArray[np.bool_]
    group: NDArray[np.int64]
    columns: Floats
    across: Floats

    def __len__(self) -> int:
        return len(self.X)

    def take(self, rows: NDArray[Any]) -> Observed:
        """Some of the strokes: a mask (n), or indices."""
        return Observed(*(getattr(self, f.name)[rows] for f in fields(self)))

    def features(self, names: Sequence[str]) -> Floats:
        """The named features, (n, names)."""
        return self.X[:, [NAMES.index(name) for name in names]]

    def of(self, name: str) -> Floats:
        """The truth of this name, (n), of `probe_model.OUTPUTS` or `TISSUE`."""
        if name in TISSUE:
            return self.tissue[:, TISSUE.index(name)]
        return self.truth[:, OUTPUTS.index(name)]

    @property
    def values(self) -> Floats:
        """The true outputs in the units of the wire, (n, outputs)."""
        return from_link(self.truth)

    @property
    def press(self) -> Floats:
        """The features that tell of the press, (n, 12), by `press_features.NAMES`."""
        return self.X[:, press_features.PLACES]

    @property
    def pressed(self) -> NDArray[np.bool_]:
        """Whether the probe saw enough of the press before each stroke, (n)."""
        return np.asarray(self.press[:, 0] != ABSENT)


def joined(parts: Sequence[Observed]) -> Observed:
    """Several sets of strokes as one."""
    return Observed(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Observed)))


def noise_named(noise: Noise | str) -> Noise:
    """A noise level by its name, or of a characterised sensor's file (`sim.probe.noise.level_named`)."""
    if isinstance(noise, Noise):
        return noise
    return level_named(noise)


def observe(
    fields: Sequence[StrokeField],
    noise: Noise | str,
    seed: int,
    force_map: bytes | None = None,
    alter: Alter | None = None,
) -> Observed:
    """One stroke over each field, each by a probe of its own; the same seed gives the same strokes.

    Parameters
    ----------
    fields : one for each stroke
    noise : Noise or name
    seed : int
    force_map : blob of `palpate.model_export.integers.force_map`, or None
    alter : changes the counts (frames, cells) as another sensor would, for example one with fewer bits
    """
    level = noise_named(noise)

    def stroke(field: StrokeField, k: int) -> tuple[FrameStream, Calibration]:
        probe = SensorModel(field, level, _seed_of(seed, k))
        stream = probe.stroke()
        if alter is not None:
            stream = replace(stream, packed=[pack(c) for c in alter(stream.counts)])
        return stream, probe.calibration()

    made = (stroke(field, k) for k, field in enumerate(fields))
    return of_streams(made, range(len(fields)), force_map)


def observe_in_any_fat(
    lumps: Sequence[LumpStrokes],
    noise: Noise | str,
    seed: int,
    force_map: bytes | None,
    first: int = 0,
    fat_kPa: Sequence[float] | None = None,
    two_apart_mm: tuple[float, float] | None = None,
    told: bool = False,
) -> Observed:
    """One stroke with its press over each lump, each in a fat and by a probe and a hand of its own.

    A stroke so light that the probe saw too little of its press is left out: it has none to learn from, and
    is outside every domain.

    Parameters
    ----------
    first : int
        The number of the first lump, if these are part of a longer set.
    fat_kPa : sequence of float, optional
        Of each lump's fat; by default at random (`random_scale`), or `own_fat` where it is told.
    two_apart_mm : (float, float), optional
        Two lumps of a kind instead of one, so far apart (`sim.probe.two_lumps.random_pair`).
    told : bool
        A model is told the fat: each lump lies in the one that it was simulated in.
    """
    level = noise_named(noise)
    if told and fat_kPa is None:
        fat_kPa = own_fat(lumps)
    fats = [None] * len(lumps) if fat_kPa is None else fat_kPa
    probes = (
        probe_over(lump, level, seed, k, fat, two_apart_mm)
        for k, (lump, fat) in enumerate(zip(lumps, fats), first)
    )
    made = ((p.sensors.stroke(press=PRESS_FRAMES, pressed=p.press), p.sensors.calibration()) for p in probes)
    seen = of_streams(made, range(first, first + len(lumps)), force_map)
    return seen.take(seen.pressed)


def own_fat(lumps: Sequence[LumpStrokes]) -> list[float]:
    """The modulus of each lump's fat as it was simulated, kPa."""
    return [lump.low.case.fat_kPa for lump in lumps]


@dataclass(frozen=True)
class ProbeOver:
    """A probe in a hand of its own over a lump whose moduli are times `scale`; `rng`: what else is random."""

    sensors: SensorModel
    press: StrokeField
    scale: float
    rng: np.random.Generator


def probe_over(
    lump: LumpStrokes,
    noise: Noise,
    seed: int,
    k: int,
    fat_kPa: float | None = None,
    two_apart_mm: tuple[float, float] | None = None,
) -> ProbeOver:
    """The k-th probe of this seed, over the lump in this fat; see `observe_in_any_fat`."""
    rng = np.random.default_rng([seed, k])
    s = random_scale(lump.case, rng)
    if fat_kPa is not None:
        s = fat_kPa / lump.case.fat_kPa
    lump = lump.scaled(s)
    if two_apart_mm is None:
        field = StrokeField(*lump.strokes)
    else:
        field = random_pair(lump.strokes, two_apart_mm, np.random.default_rng((seed, k, 1)))
    return ProbeOver(SensorModel(field, noise, int(rng.integers(1 << 40))), StrokeField(*lump.press), s, rng)


def of_streams(
    made: Iterable[tuple[FrameStream, Calibration]], groups: Sequence[int], force_map: bytes | None
) -> Observed:
    """Strokes as the wire carries them, with their probes' calibrations, through the pipeline."""
    replay = Replay(force_map)
    X, truth, tissue, codes, columns, across = [], [], [], [], [], []
    for stream, calibration in made:
        codes.append(replay.stream(stream, calibration))
        X.append(replay.features())
        columns.append(np.array(replay.pipeline.columns, float))
        case = stream.truth.case
        truth.append(list(stream.truth.outputs().values()))
        tissue.append(_tissue(stream.truth))
        across.append([np.log(2 * case.half_axes_mm[1]), case.offset_mm])
    whole = np.isin(codes, (status.OK, status.NO_FIT))
    features = np.array(X).reshape(-1, len(NAMES))
    return Observed(
        features,
        to_link(np.array(truth, float).reshape(-1, outputs.COUNT)),
        np.array(tissue, float).reshape(-1, len(TISSUE)),
        whole,
        whole & shows_lump(features, NAMES),
        np.asarray(groups, int),
        np.array(columns),
        np.array(across).reshape(-1, 2),
    )


def _tissue(of: Truth) -> list[float]:
    """By `TISSUE`."""
    return [*np.log([of.case.depth_mm, of.F_N_per_m / of.fat_kPa]), of.case.gland_ratio, of.case.gland_mm]


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


def in_usual_tissue(seen: Observed) -> NDArray[np.bool_]:
    """Which strokes are over tissue as most breasts have it, pressed as most hands press, (n)."""
    fat, force, reach = (np.exp(seen.of(name)) for name in ("ln E_fat", "ln F", "ln F/E_fat"))
    within = (seen.of("gland_ratio") >= USUAL_RATIO) & (reach <= USUAL_REACH_MM)
    for value, (low, high) in ((fat, USUAL_FAT_KPA), (force, USUAL_FORCE_N_PER_M)):
        within &= (low <= value) & (value <= high)
    return within


def _seed_of(seed: int, k: int) -> int:
    return int(np.random.SeedSequence([seed, k]).generate_state(1, np.uint64)[0] >> 1)
