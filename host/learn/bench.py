"""The bench: strokes of one directory, split by lump, to be observed through any sensors."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.learn.data import Split, Strokes, split, stroke_fields
from palpate.learn.model import learn_force_map
from palpate.learn.observed import Observed, noise_named
from palpate.learn.observer import Observer
from palpate.learn.scopes import FIELD, Recipe
from palpate.model_export.fixed_point import force_map as force_maps
from palpate.progress import ProgressCallback
from palpate.sim.probe.sensors import Noise, StrokeField

TRAIN_DRAWS, CALIBRATION_DRAWS, TEST_DRAWS, RIM_DRAWS = 4, 2, 4, 2
_SEED_STEP = 1000
_RIM_FIRST = 600


class Bench:
    """The strokes of one directory, split by lump, observed through any sensors; a context manager.

    Parameters
    ----------
    strokes : Strokes
    seed : int
        Of the split and of all noise.
    directory : path
        Where they come from; studies of other tissues store theirs beside them.
    workers : int, optional
        Processes that observe strokes; by default one for each core.
    progress : callable, optional
        See `progress.ProgressCallback`.
    noise : Noise or str
        The sensors of the studies, but for what a study varies: a level, or a characterised sensor's file.
    """

    def __init__(
        self,
        strokes: Strokes,
        seed: int = 1,
        directory: str | PathLike[str] = ".",
        workers: int | None = None,
        progress: ProgressCallback | None = None,
        noise: Noise | str = "typical",
    ) -> None:
        self.strokes, self.seed, self.directory = strokes, seed, Path(directory)
        self.workers, self.progress = workers, progress
        self.observer = Observer(workers, progress)
        self.noise = noise_named(noise)
        self.lumps = stroke_fields(strokes.lumps)
        self.rim = stroke_fields(strokes.rim)
        self.plain = stroke_fields(strokes.plain)
        self.wide = stroke_fields(strokes.wide)
        self.split: Split = split(len(self.lumps), seed)
        self.force_map = self._learn_force_map()
        self.blob = force_maps.blob(self.force_map)

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self.observer.__exit__()

    @cached_property
    def pressure_map(self) -> force_maps.ForceMap:
        """The force map that does without displacement."""
        return self._learn_force_map(displacement=False)

    def force_map_of(self, recipe: Recipe) -> force_maps.ForceMap | None:
        """How a recipe moves frames to the stroke's mean force; None where it does not."""
        if not recipe.force_map:
            return None
        return self.force_map if recipe.displacement else self.pressure_map

    def _learn_force_map(self, displacement: bool = True) -> force_maps.ForceMap:
        lumps = [self.strokes.lumps[k] for k in self.split.train]
        return learn_force_map(lumps + self.strokes.rim, displacement)

    def observe(
        self,
        fields: Sequence[StrokeField],
        which: NDArray[np.int64],
        noise: Noise | str,
        draws: int,
        first_draw: int,
        recipe: Recipe = FIELD,
        **options: Any,
    ) -> Observed:
        """`draws` strokes over each of some fields, each by a different probe in a different hand.

        The frames are moved by the force map of `recipe`.

        `options` are further options of `observed.observe`, as mean_forces_N_per_m.
        """
        first = self.seed * _SEED_STEP + first_draw
        found = self.force_map_of(recipe)
        options["force_map"] = None if found is None else force_maps.blob(found)
        chosen, groups = [fields[k] for k in which], [int(k) for k in which]
        return self.observer.observe(
            chosen, noise_named(noise), range(first, first + draws), groups, **options
        )

    def parts(
        self,
        noise: Noise | str,
        recipe: Recipe = FIELD,
        draws: tuple[int, int, int] = (TRAIN_DRAWS, CALIBRATION_DRAWS, TEST_DRAWS),
        **options: Any,
    ) -> tuple[Observed, Observed, Observed, Observed | None]:
        """Training, calibration, test and rim strokes over lumps, at one noise level."""
        s = self.split
        rim_draws = min(RIM_DRAWS, draws[0])
        if noise_named(noise) == Noise():
            draws, rim_draws = (1, 1, 1), 1
        which = (s.train, s.calibration, s.test)
        train, calibration, test = (
            self.observe(self.lumps, lumps, noise, n, 100 * k, recipe, **options)
            for k, (lumps, n) in enumerate(zip(which, draws))
        )
        if not self.rim:
            return train, calibration, test, None
        every = np.arange(len(self.rim))
        rim = self.observe(self.rim, every, noise, rim_draws, _RIM_FIRST, recipe, **options)
        return train, calibration, test, rim
