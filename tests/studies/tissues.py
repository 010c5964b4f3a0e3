"""How far off the field model is in tissue that it was not trained on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from palpate.learn.cylinders import every_check
from palpate.learn.data import simulate_missing
from palpate.learn.design import lump_cases
from palpate.learn.lumps import LumpStrokes, read_pressed
from palpate.learn.model import FittedModel, fit_model
from palpate.learn.observed import Observed, joined, observe_in_any_fat
from palpate.learn.probe_model import OUTPUTS
from palpate.learn.scopes import TOLD
from palpate.learn.strange import StrangeStrokes, observe_strange
from palpate.progress import ProgressCallback
from palpate.sim.tissue.any_tissue import FORCE_PARTS, PRESS_PARTS, PRESSES, STROKES, at_forces
from tests.studies.retrained import DRAWS, Bench, Row, Study, row_of

LUMPS = 32
_SEED = 7
TWO_APART_MM = (8.0, 12.0, 16.0, 20.0, 30.0)
TISSUES: dict[str, dict[str, float]] = {
    "gland 4 times the fat, not 6": {"gland_ratio": 4.0},
    "gland 8 times the fat": {"gland_ratio": 8.0},
    "fat 30 % softer": {"fat_kPa": 7.0},
    "fat 30 % stiffer": {"fat_kPa": 13.0},
    "fat that stiffens (b = 3)": {"fat_stiffening": 3.0},
    "probe radius 10 % smaller": {"probe_radius_mm": 36.0},
    "probe radius 10 % larger": {"probe_radius_mm": 44.0},
}


def other_tissue(
    directory: Path,
    changes: dict[str, float],
    lumps: int = LUMPS,
    workers: int | None = None,
    progress: ProgressCallback | None = None,
) -> list[LumpStrokes]:
    """Strokes over lumps in another tissue and their presses, simulated under `directory` where they are
    missing."""
    name = "tissue-" + "-".join(f"{k}-{v:g}" for k, v in sorted(changes.items()))
    cases, press = lump_cases(lumps, _SEED, changes), f"{name}-press"
    parts = {
        name: (at_forces(cases, FORCE_PARTS), STROKES),
        press: (at_forces(cases, PRESS_PARTS), PRESSES),
    }
    simulate_missing(parts, directory, workers, progress)
    return read_pressed(directory / name, directory / press)


def _run(bench: Bench) -> Iterator[Row]:
    watch = StrangeStrokes(bench.noise, bench.seed, bench.blob, told=True)
    felt = partial(_felt, bench)
    train, strokes = felt(bench.train, 0), replace(bench.strokes, lumps=bench.train)
    model = fit_model(TOLD, train, felt(bench.strokes.rim, 100))
    strange = observe_strange(watch, bench.train, bench.strokes.plain)
    model = replace(model, checks=every_check(model, train, watch, strange, strokes))
    yield tissue_row("as trained", model, felt(bench.test, 200))
    for apart in TWO_APART_MM:
        seen = watch.pairs(bench.test, (apart, apart), 1)
        yield tissue_row(f"two lumps {apart:g} mm apart", model, seen)
    for words, changes in TISSUES.items():
        lumps = other_tissue(bench.directory, changes, progress=bench.progress)
        yield tissue_row(words, model, felt(lumps, 300))


def _felt(bench: Bench, lumps: list[LumpStrokes], draw: int) -> Observed:
    """`DRAWS` strokes with their presses over each."""
    seeds = range(1000 * bench.seed + draw, 1000 * bench.seed + draw + DRAWS)
    return joined([observe_in_any_fat(lumps, bench.noise, seed, bench.blob, told=True) for seed in seeds])


def tissue_row(words: str, model: FittedModel, observed: Observed) -> Row:
    """Scores of a model on strokes over some tissue, with the bias of its estimates and the share flagged.

    `silent`: the share whose interval of d misses the truth with no flag to say so.
    """
    row, said = row_of(words, model, observed)
    off = said.y - said.seen.truth[:, : said.y.shape[1]]
    row |= {f"{name}_bias": float(np.expm1(np.median(off[:, OUTPUTS.index(f"ln {name}")]))) for name in "tdh"}
    d = OUTPUTS.index("ln d")
    wrong = np.abs(off[:, d]) > said.half[:, d]
    row["silent"] = float((wrong & said.in_domain).mean())
    return row


TISSUE = Study("tissue", "A tissue, or a probe, that the model was not trained on", "what differs", _run)
STUDIES = {TISSUE.name: TISSUE}
