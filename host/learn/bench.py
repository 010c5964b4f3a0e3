"""The bench: strokes of one directory, split by lump, to be observed through any sensors.

Many are observed on all cores, with the same result whatever their number.
"""

from __future__ import annotations

import multiprocessing
import operator
import os
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.learn.data import Split, Strokes, split
from palpate.learn.model import learn_force_map
from palpate.learn.observed import Observed, joined, noise_named, observe
from palpate.learn.scopes import FIELD, Recipe
from palpate.model_export.integers import force_map as force_maps
from palpate.progress import ProgressCallback
from palpate.sim.probe.sensors import Noise, StrokeField
from palpate.sim.tissue.workers import QuietPool

AT_A_TIME, WORTH_A_POOL = 48, 600
"""Strokes that a process observes at a time; so few that it takes less time than processes take to start."""

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
        self.workers, self.progress = workers or os.cpu_count() or 1, progress
        self.noise = noise_named(noise)
        self.lumps, self.rim, self.plain, self.wide = (
            [lump.field for lump in part]
            for part in (strokes.lumps, strokes.rim, strokes.plain, strokes.wide)
        )
        self.split: Split = split(len(self.lumps), seed)
        self.force_map = self._learn_force_map()
        self.blob = force_maps.blob(self.force_map)

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        if "_pool" in self.__dict__:
            self._pool.shutdown(cancel_futures=True)
            del self._pool

    @cached_property
    def _pool(self) -> QuietPool:
        return QuietPool(self.workers, mp_context=multiprocessing.get_context("spawn"))

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

        `options` are further options of `observed.observe`, as alter.
        """
        found, first = self.force_map_of(recipe), self.seed * _SEED_STEP + first_draw
        options["force_map"] = None if found is None else force_maps.blob(found)
        jobs: list[Callable[[], Observed]] = []
        for seed in range(first, first + draws):
            for at in range(0, len(which), AT_A_TIME):
                groups = [int(k) for k in which[at : at + AT_A_TIME]]
                some = [fields[k] for k in groups]
                jobs.append(partial(observe, some, noise_named(noise), seed, groups, first=at, **options))
        total, parts = draws * len(which), []
        alone = self.workers < 2 or total < WORTH_A_POOL
        for part in (map if alone else self._pool.map)(operator.call, jobs):
            parts.append(part)
            if self.progress is not None:
                self.progress("strokes observed through the sensors", sum(map(len, parts)), total)
        return joined(parts)

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
