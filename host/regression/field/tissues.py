"""How wrong the field model is where the tissue is not the one it was trained on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from host.regression.field.bench import Bench
from host.regression.field.data import read_pairs, stroke_fields, watched
from host.regression.field.design import FIELD_SETTINGS, LumpPair, lump_cases
from host.regression.field.model import FieldModel, fit_field_model
from host.regression.field.recipe import FIELD
from host.regression.field.score import coverage
from host.regression.field.study import DRAWS, TYPICAL, Row, Study, row_of
from host.regression.seen import Seen, look
from host.regression.table import TARGETS
from host.regression.watch import Watch
from sim.tissue import sweep

LUMPS = 32
_SEED = 7
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
    watch: Watch | None = None,
) -> list[LumpPair]:
    """Pairs of strokes over lumps in another tissue, simulated under `directory` where they are missing."""
    name = "tissue-" + "-".join(f"{k}-{v:g}" for k, v in sorted(changes.items()))
    if not (directory / name / "strokes.parquet").exists():
        report = watched(f"simulating {name}", watch)
        cases = lump_cases(lumps, _SEED, tissue=changes)
        sweep(cases, FIELD_SETTINGS, directory / name, workers=workers, progress=report)
    return read_pairs(directory / name)[0]


def _run(bench: Bench) -> Iterator[Row]:
    train, calibration, test, rim = bench.parts(TYPICAL, True, DRAWS)
    model = fit_field_model(FIELD, train, calibration, rim)
    yield tissue_row("as trained", model, test)
    for words, changes in TISSUES.items():
        pairs = other_tissue(bench.directory, changes, workers=bench.workers, watch=bench.watch)
        fields = stroke_fields(pairs)
        seen = look(fields, TYPICAL, 900, force_map=bench.blob)
        yield tissue_row(words, model, seen)


def tissue_row(words: str, model: FieldModel, seen: Seen) -> Row:
    """Scores of a model on strokes over some tissue, with the bias of its estimates and the share flagged."""
    answers = model.answer(seen)
    row = row_of(words, model, seen, answers)
    found = answers.lump
    ratio = np.median(answers.value[found] / seen.Y[found], axis=0)
    row |= {f"{t}_bias": float(r - 1) for t, r in zip(TARGETS, ratio)}
    row["covered_d"] = float(coverage(seen, answers, found)["d"]["all"])
    row["flagged"] = float((~answers.in_domain[found]).mean())
    return row


TISSUE_STUDY = Study(
    "tissue", "A tissue, or a probe, that the model was not trained on", "what differs", _run
)
