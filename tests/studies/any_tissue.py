"""Tissue that the probe knows nothing about: how good the estimates are with and without the press."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pandas as pd

from palpate.learn.data import SEED, sweep_progress
from palpate.learn.lumps import LumpStrokes, read_pressed
from palpate.learn.model import force_map_of
from palpate.learn.observed import joined, observe_in_any_fat
from palpate.learn.study import DRAWS, Study, text_of
from palpate.progress import ProgressCallback
from palpate.sim.tissue import sweep
from palpate.sim.tissue.any_tissue import PRESSES, STROKES, any_tissue_cases, press_cases
from tests.studies.table import Asked, StudyTable

LUMPS = 600
LEVELS = ("typical", "real")
"""Of the table, unless others are asked for."""


def prepare(
    directory: Path, lumps: int, workers: int | None = None, progress: ProgressCallback | None = None
) -> list[LumpStrokes]:
    """Simulate into `directory` what it lacks of that many lumps (see `any_tissue_cases`), and read them."""
    presses, strokes = directory / "press", directory / "lumps"
    report = sweep_progress("pressing", progress)
    sweep(press_cases(lumps, SEED), PRESSES, presses, workers=workers, progress=report)
    report = sweep_progress("stroking", progress)
    sweep(any_tissue_cases(lumps, SEED), STROKES, strokes, workers=workers, progress=report)
    return read_pressed(strokes, presses)


def table_of(
    lumps: Sequence[LumpStrokes],
    levels: Sequence[str] = LEVELS,
    draws: int = DRAWS,
    seed: int = 1,
    step: Callable[[str], None] | None = None,
) -> pd.DataFrame:
    """One row a setting: the stroke alone and with its press, at each level of noise."""
    return pd.DataFrame(list(_rows(lumps, levels, draws, seed, step)))


def _rows(
    lumps: Sequence[LumpStrokes],
    levels: Sequence[str],
    draws: int,
    seed: int,
    step: Callable[[str], None] | None,
) -> Iterator[dict[str, object]]:
    blob = force_map_of(lumps)
    for level in levels:
        seen = joined([observe_in_any_fat(lumps, level, 1000 * seed + k, blob) for k in range(draws)])
        if step:
            step(f"{level}: seen")
        yield Study.held_out(seen, False, step=step).row(f"{level}, the stroke alone")
        yield Study.held_out(seen, True, step=step).row(f"{level}, with its press")


def tables(asked: Asked) -> list[StudyTable]:
    """With and without the press, at each level of noise."""
    lumps = prepare(asked.directory, asked.lumps or LUMPS, progress=asked.progress)
    levels = LEVELS if asked.noise is None else (asked.noise,)
    found = table_of(lumps, levels, seed=asked.seed, step=asked.tell)
    return [StudyTable("Tissue that the probe knows nothing about", *text_of(found), found)]
