"""Strokes as the probe observes them: quantised noisy frames through the firmware's own integer pipeline."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import feature_names, outputs, status
from palpate.features.map_features import Floats
from palpate.firmware_twin.replay_core import Replay
from palpate.sim.probe.noise import level_named
from palpate.sim.probe.sensors import PRESS_FRAMES, Noise, SensorModel, StrokeField, pack

NAMES = feature_names.NAMES
OF_THE_DISPLACEMENT = tuple(
    name for name in NAMES if name.startswith(("ln_d28", "ln_d0", "ln_d_far", "dip_", "press_d_"))
)
"""Features that a recording without displacement does not have."""
Alter = Callable[[NDArray[np.uint16]], NDArray[np.uint16]]


@dataclass(frozen=True)
class ObservedStrokes:
    """n strokes as features with their truth.

    Attributes
    ----------
    X : (n, features)
        Every feature of the firmware, by `feature_names.NAMES`.
    status : (n), int
        The pipeline's status: OK, NO_FIT (no bump; features are valid), TOO_SHORT (they are not).
    Y : (n, 5)
        True F (N/m, of the force that the hand kept), t, d (mm), h, E^-2/3: `learn.table.TARGETS`.
    lump : (n), bool
    group : (n), int
        Which lump: strokes of one lump share it.
    """

    X: Floats
    status: NDArray[np.int64]
    Y: Floats
    lump: NDArray[np.bool_]
    group: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.status)

    def take(self, rows: NDArray[Any]) -> ObservedStrokes:
        """Some of the strokes: a mask (n), or indices."""
        return ObservedStrokes(
            self.X[rows], self.status[rows], self.Y[rows], self.lump[rows], self.group[rows]
        )

    def columns(self, names: Sequence[str]) -> Floats:
        """The named features, (n, names)."""
        return self.X[:, [NAMES.index(name) for name in names]]

    @property
    def whole(self) -> NDArray[np.bool_]:
        """Strokes whose features are valid."""
        return np.isin(self.status, (status.OK, status.NO_FIT))


def join(parts: Sequence[ObservedStrokes]) -> ObservedStrokes:
    """Several sets of strokes as one."""
    return ObservedStrokes(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in ("X", "status", "Y", "lump", "group"))
    )


def noise_named(noise: Noise | str) -> Noise:
    """A noise level by its name, or of a characterised sensor's file (`sim.probe.noise.level_named`)."""
    if isinstance(noise, Noise):
        return noise
    return level_named(noise)


def observe(
    fields: Sequence[StrokeField],
    noise: Noise | str,
    seed: int,
    groups: Sequence[int] | None = None,
    force_map: bytes | None = None,
    n_frames: int = 50,
    alter: Alter | None = None,
    mean_forces_N_per_m: Sequence[float] | None = None,
    first: int = 0,
    **sensor: Any,
) -> ObservedStrokes:
    """One stroke over each field, each by a probe of its own; the same seed gives the same strokes.

    Parameters
    ----------
    fields : one for each stroke, which a press precedes where it has one
    noise : Noise or name
    seed : int
    groups : which lump each field is; by default its place in `fields`
    force_map : blob of `palpate.model_export.fixed_point.force_map`, or None
    n_frames : int
    alter : changes the counts (frames, cells) as another sensor would, for example one with fewer bits
    mean_forces_N_per_m : the hand's mean force for each stroke; by default the middle of the pair
    first : the number of the first stroke, if these are part of a longer set
    **sensor : further arguments of `SensorModel`
    """
    noise = noise_named(noise)
    replay = Replay(force_map)
    X = np.empty((len(fields), len(NAMES)))
    codes = np.empty(len(fields), int)
    Y = np.empty((len(fields), outputs.E_FAT))
    lump = np.empty(len(fields), bool)
    for k, field in enumerate(fields):
        mean = None if mean_forces_N_per_m is None else mean_forces_N_per_m[k]
        model = SensorModel(field, noise, _seed_of(seed, first + k), mean_force_N_per_m=mean, **sensor)
        stream = model.stroke(n_frames, press=PRESS_FRAMES if field.press else 0, pressed=field.press)
        if alter is not None:
            stream = replace(stream, packed=[pack(c) for c in alter(stream.counts)])
        codes[k] = replay.stream(stream, model.calibration())
        X[k] = replay.features()
        Y[k], lump[k] = list(stream.truth.outputs().values())[: outputs.E_FAT], stream.truth.lump
    group = np.arange(len(fields)) if groups is None else np.asarray(groups, int)
    return ObservedStrokes(X, codes, Y, lump, group)


def _seed_of(seed: int, k: int) -> int:
    return int(np.random.SeedSequence([seed, k]).generate_state(1, np.uint64)[0] >> 1)
