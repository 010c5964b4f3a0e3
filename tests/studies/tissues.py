"""How far off the field model is in tissue that it was not trained on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from palpate.learn.bench import Bench
from palpate.learn.data import simulate_missing
from palpate.learn.design import FIELD_SETTINGS, PRESS_SETTINGS, lump_cases, press_cases
from palpate.learn.lumps import LumpStrokes, read_lumps, with_presses
from palpate.learn.model import FittedModel, fit_model
from palpate.learn.observed import Observed, joined, observe
from palpate.learn.other_tissues import strange_strokes
from palpate.learn.scopes import FIELD, TOLD
from palpate.learn.score import coverage
from palpate.learn.table import TARGETS
from palpate.progress import ProgressCallback
from palpate.sim.probe.two_lumps import TwoLumps
from tests.studies.retrained import DRAWS, Row, Study, row_of

LUMPS = 32
_SEED, _OBSERVED = 7, (900, 901, 902, 903)
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
    simulate_missing(
        {name: (lump_cases(lumps, _SEED, tissue=changes), FIELD_SETTINGS)}, directory, workers, progress
    )
    found = read_lumps(directory / name)[0]
    press = f"{name}-press"
    simulate_missing({press: (press_cases(found), PRESS_SETTINGS)}, directory, workers, progress)
    return with_presses(found, directory / press)


def _run(bench: Bench) -> Iterator[Row]:
    train, calibration, test, rim = bench.parts(bench.noise, draws=DRAWS)
    strange = strange_strokes(bench, bench.noise, FIELD)
    model = fit_model(TOLD.of(FIELD), train, calibration, rim, checks=strange.checks if strange else None)
    yield tissue_row("as trained", model, test)
    for apart in TWO_APART_MM:
        fields = list(bench.lumps)
        for k in bench.split.test:
            lump = bench.strokes.lumps[k]
            fields[k] = TwoLumps(*lump.strokes, apart_mm=apart, press=lump.press)
        yield tissue_row(
            f"two lumps {apart:g} mm apart",
            model,
            bench.observe(fields, bench.split.test, bench.noise, 1, 900),
        )
    for words, changes in TISSUES.items():
        lumps = other_tissue(bench.directory, changes, workers=bench.workers, progress=bench.progress)
        fields = [lump.field for lump in lumps]
        seen = [observe(fields, bench.noise, seed, force_map=bench.blob) for seed in _OBSERVED]
        observed = joined(seen)
        yield tissue_row(words, model, observed)


def tissue_row(words: str, model: FittedModel, observed: Observed) -> Row:
    """Scores of a model on strokes over some tissue, with the bias of its estimates and the share flagged.

    `silent`: the share whose interval of d misses the truth with no flag to say so.
    """
    answers = model.answer(observed)
    row = row_of(words, model, observed, answers)
    found = answers.found
    ratio = np.median(answers.value[found] / observed.values[found, : len(TARGETS)], axis=0)
    row |= {f"{t}_bias": float(r - 1) for t, r in zip(TARGETS, ratio)}
    row["covered_d"] = float(coverage(observed, answers, found)["d"]["all"])
    row["flagged"] = float((~answers.in_domain[found]).mean())
    d = TARGETS.index("d")
    true = observed.values[:, d]
    wrong = (true < answers.low[:, d]) | (true > answers.high[:, d])
    row["silent"] = float((wrong & answers.in_domain)[found].mean())
    return row


TISSUE = Study(
    "tissue", "A tissue, or a probe, that the model was not trained on", "what differs", _run, True
)
STUDIES = {TISSUE.name: TISSUE}
