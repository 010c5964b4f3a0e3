"""The bench: strokes of one directory, split by lump, to be looked at through any sensors."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from host.regression.field.data import FieldStrokes, Split, split, stroke_fields
from host.regression.field.model import learn_force_map
from host.regression.seen import Seen, join, look, noise_named
from model_export import force_map as force_maps
from sim.probe.sensors import Noise, StrokeField

TRAIN_DRAWS, CALIBRATION_DRAWS, TEST_DRAWS = 4, 2, 4
_SEED_STEP = 1000


class Bench:
    """The strokes of one directory, split by lump, looked at through any sensors.

    Parameters
    ----------
    strokes : FieldStrokes
    seed : int
        Of the split and of all noise.
    directory : path
        Where they came from; studies of other tissues keep theirs beside them.
    """

    def __init__(self, strokes: FieldStrokes, seed: int = 1, directory: str | PathLike[str] = ".") -> None:
        self.strokes, self.seed, self.directory = strokes, seed, Path(directory)
        self.lumps = stroke_fields(strokes.lumps)
        self.rim = stroke_fields(strokes.rim)
        self.plain = stroke_fields(strokes.plain)
        self.wide = stroke_fields(strokes.wide)
        self.split: Split = split(len(self.lumps), seed)
        self.force_map = learn_force_map([strokes.lumps[k] for k in self.split.train] + strokes.rim)
        self.blob = force_maps.blob(self.force_map)

    def see(
        self,
        fields: Sequence[StrokeField],
        which: NDArray[np.int64],
        noise: Noise | str,
        draws: int,
        first_draw: int,
        force_map: bool = True,
        **sensor: Any,
    ) -> Seen:
        """`draws` strokes over each of some fields, every one by another probe in another hand."""
        chosen = [fields[k] for k in which]
        blob = self.blob if force_map else None
        seed = self.seed * _SEED_STEP + first_draw
        return join([look(chosen, noise, seed + k, list(which), blob, **sensor) for k in range(draws)])

    def see_at(
        self,
        which: NDArray[np.int64],
        noise: Noise | str,
        draws: int,
        first_draw: int,
        mean_forces_N_per_m: Sequence[float],
    ) -> Seen:
        """`draws` strokes over each of some lumps at a mean force of its own."""
        seed = self.seed * _SEED_STEP + first_draw
        chosen = [self.lumps[k] for k in which]
        return join(
            [
                look(chosen, noise, seed + k, list(which), self.blob, mean_forces_N_per_m=mean_forces_N_per_m)
                for k in range(draws)
            ]
        )

    def parts(
        self,
        noise: Noise | str,
        force_map: bool = True,
        draws: tuple[int, int, int] = (TRAIN_DRAWS, CALIBRATION_DRAWS, TEST_DRAWS),
        **sensor: Any,
    ) -> tuple[Seen, Seen, Seen, Seen | None]:
        """Training, calibration, test and rim strokes over lumps, at one noise level."""
        s = self.split
        if noise_named(noise) == Noise():
            draws = (1, 1, 1)
        which = (s.train, s.calibration, s.test)
        train, calibration, test = (
            self.see(self.lumps, lumps, noise, n, 100 * k, force_map, **sensor)
            for k, (lumps, n) in enumerate(zip(which, draws))
        )
        every = np.arange(len(self.rim))
        rim = self.see(self.rim, every, noise, draws[0], 600, force_map, **sensor) if self.rim else None
        return train, calibration, test, rim
