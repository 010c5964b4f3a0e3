"""Lumps that the probe knows nothing about, simulated for the studies that need them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from palpate.learn.data import SEED, sweep_progress
from palpate.learn.lumps import LumpStrokes, read_pressed
from palpate.progress import ProgressCallback
from palpate.sim.tissue import Case, sweep
from palpate.sim.tissue.any_tissue import (
    FORCE_PARTS,
    PRESS_PARTS,
    PRESSES,
    STROKES,
    TissueRanges,
    at_forces,
    random_lumps,
)

LUMPS = 600


def prepare(
    directory: Path, lumps: int, workers: int | None = None, progress: ProgressCallback | None = None
) -> list[LumpStrokes]:
    """That many lumps on the border of fat and gland, in tissue of all kinds; see `simulated`."""
    return simulated(directory, random_lumps(lumps, SEED, TissueRanges()), workers, progress)


def simulated(
    directory: Path, drawn: Sequence[Case], workers: int | None, progress: ProgressCallback | None
) -> list[LumpStrokes]:
    """Simulate into `directory` what it lacks of strokes over these lumps and their presses; read them."""
    presses, strokes = directory / "press", directory / "lumps"
    for words, home, parts, settings in (
        ("pressing", presses, PRESS_PARTS, PRESSES),
        ("stroking", strokes, FORCE_PARTS, STROKES),
    ):
        cases, report = at_forces(list(drawn), parts), sweep_progress(words, progress)
        sweep(cases, settings, home, workers=workers, progress=report)
    return read_pressed(strokes, presses)
