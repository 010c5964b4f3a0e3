"""How often the intervals of the model that was told the thesis' tissue hold, on
lumps that it has never met.

The depth is no output of the model: its interval follows from those of t, d and h (`palpate.spans`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from palpate import models
from palpate.dataset.answers import shows_lump
from palpate.features.map_features import Floats
from palpate.learn.conformal import LEVEL
from palpate.learn.data import sweep_progress
from palpate.learn.design import lump_cases
from palpate.learn.lumps import read_lumps
from palpate.learn.observed import Observed, observe
from palpate.learn.table import SHOWN, TARGETS
from palpate.model_export.integers import force_map as force_maps
from palpate.model_export.integers.reference import evaluate
from palpate.model_export.schema import ModelSpec
from palpate.progress import ProgressCallback
from palpate.sim.tissue import sweep
from palpate.sim.tissue.any_tissue import FORCE_PARTS, STROKES, at_forces
from palpate.spans import depth_mm
from palpate.wire.events import OUTPUTS
from tests.studies.table import Asked, StudyTable

SEED = 91
"""Of the lumps and their noise. 1, 5, 11, 13, 21, 23 and 77 were used to choose, to fit or to score."""
LUMPS = 512

NAMES = OUTPUTS[: len(TARGETS)]
"""What it estimates; it repeats the fat that it was told."""

T, D, H = (NAMES.index(name) for name in ("t_mm", "d_mm", "h"))


def coverage(
    directory: Path, lumps: int = LUMPS, progress: ProgressCallback | None = None
) -> tuple[pd.DataFrame, int]:
    """Share of true values inside the intervals, of one stroke over each lump at typical noise.

    The lumps are simulated into `directory`.

    Returns
    -------
    DataFrame
        Rows: all, and the quarters of the true depth, d and h; columns: n, the model's outputs, `depth`, and
        `independent`: the depth's, were the errors of t and d independent.
    int
        How many lumps were not found.
    """
    spec = models.load(models.TOLD)
    report = sweep_progress("simulating lumps", progress)
    sweep(at_forces(lump_cases(lumps, SEED, {}), FORCE_PARTS), STROKES, directory, progress=report)
    strokes, _, _ = read_lumps(directory)
    blob = None if spec.force_map is None else force_maps.blob(spec.force_map)
    seen = observe([lump.field for lump in strokes], "typical", SEED, force_map=blob)
    found = seen.whole & shows_lump(spec, seen.X)
    return _shares(spec, seen.take(found)), int((~found).sum())


def held(spec: ModelSpec, seen: Observed) -> dict[str, NDArray[np.bool_]]:
    """Whether each stroke's intervals hold the truth: of the outputs, of `depth` and of `independent`."""
    said = evaluate(spec, seen.features(spec.features))
    spans = np.stack([said[part] for part in ("value", "low", "high")], axis=2)
    inside = {name: _holds(spans[:, j], seen.values[:, j]) for j, name in enumerate(NAMES)}
    true = seen.values[:, T] - seen.values[:, D] / 2
    depth = np.array([depth_mm(*map(tuple, stroke[[T, D, H]])) for stroke in spans])
    inside["depth"] = _holds(depth, true)
    inside["independent"] = _holds(_independent(spans), true)
    return inside


def _shares(spec: ModelSpec, seen: Observed) -> pd.DataFrame:
    inside = held(spec, seen)
    true = seen.values[:, T] - seen.values[:, D] / 2
    rows = {}
    for name, group in {
        "all": np.ones(len(seen), bool),
        **quarters({"depth": true, "d": seen.values[:, D], "h": seen.values[:, H]}),
    }.items():
        rows[name] = {"n": int(group.sum()), **{key: hit[group].mean() for key, hit in inside.items()}}
    return pd.DataFrame.from_dict(rows, orient="index")


def quarters(values: Mapping[str, Floats]) -> dict[str, NDArray[np.bool_]]:
    """Each quarter of each of these, (n), by name."""
    out: dict[str, NDArray[np.bool_]] = {}
    for name, of in values.items():
        edges = np.quantile(of, [0, 0.25, 0.5, 0.75, 1])
        for k in range(4):
            last = of <= edges[k + 1] if k == 3 else of < edges[k + 1]
            out[f"{name} {edges[k]:.3g} to {edges[k + 1]:.3g}"] = (of >= edges[k]) & last
    return out


def _holds(spans: Floats, true: Floats) -> NDArray[np.bool_]:
    return (spans[:, 1] - 1e-12 <= true) & (true <= spans[:, 2] + 1e-12)


def _independent(spans: Floats) -> Floats:
    """Value, low, high of t - d/2 with the half-widths of t and d added as squares."""
    value = spans[:, T, 0] - spans[:, D, 0] / 2
    half = (spans[:, :, 2] - spans[:, :, 1]) / 2
    width = np.hypot(half[:, T], half[:, D] / 2)
    return np.stack([value, value - width, value + width], axis=1)


def text_of(shares: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Heads and rows: coverage in %."""
    names = {name: SHOWN[symbol] for name, symbol in zip(NAMES, TARGETS)}
    names |= {"depth": "depth", "independent": "depth, t and d independent"}
    rows = [
        [str(group), *(f"{100 * row[key]:.1f}" for key in names), f"{row['n']:.0f}"]
        for group, row in shares.iterrows()
    ]
    return ["lumps", *names.values(), "n"], rows


def tables(asked: Asked) -> list[StudyTable]:
    """Coverage of every output's interval and of the depth's."""
    shares, lost = coverage(asked.directory, asked.lumps or LUMPS, asked.progress)
    asked.tell(f"{lost} of {lost + int(shares['n'].iloc[0])} lumps not found")
    title = f"Coverage of the {100 * LEVEL:g} % intervals, %"
    return [StudyTable(title, *text_of(shares), shares.reset_index(names="lumps"))]
