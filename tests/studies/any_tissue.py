"""Lumps in tissue that the probe knows nothing about, simulated for the studies that need them."""

from __future__ import annotations

from pathlib import Path

from palpate.learn.data import SEED, sweep_progress
from palpate.learn.lumps import LumpStrokes, read_pressed
from palpate.progress import ProgressCallback
from palpate.sim.tissue import sweep
from palpate.sim.tissue.any_tissue import PRESSES, STROKES, any_tissue_cases, press_cases

LUMPS = 600


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
