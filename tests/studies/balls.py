"""What can be seen of balls and ellipsoids, and what cannot: which are found, how well each kind is told, how
many computed lumps that takes.

Every lump is predicted by an emulator and a model that have not met it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.learn.emulator import fit_emulator
from palpate.learn.lumps import LumpStrokes, read_solids
from palpate.learn.model import force_map_of
from palpate.learn.observed import Observed
from palpate.learn.probe_model import E_INV23, HARD_BELOW, OUTPUTS
from palpate.learn.solid import held_out_folds
from palpate.learn.study import text_of as outputs_text
from palpate.learn.training import SolidStudy, judged, observed, taught, train
from tests.studies import bound_emulated
from tests.studies.table import Asked, StudyTable

BOUNDED = 64
"""Lumps that the bound is worked out for, the first ones; each takes a second."""

PARTS = 3
"""Into how many classes of d, and of h, lumps are divided."""


def classes_of(
    lumps: Sequence[LumpStrokes],
    force_map: bytes,
    noise: str = "typical",
    seed: int = 1,
    workers: int = 1,
    step: Callable[[str], None] | None = None,
) -> pd.DataFrame:
    """`table_of` all of these lumps, each asked about by a model fitted without it."""
    folds = held_out_folds(lumps, (noise,), seed, force_map, workers, step=step)
    study = judged([fold.studies[noise, True] for fold in folds])
    return table_of(observed(lumps, noise, seed, force_map), study)


def learning_of(
    lumps: Sequence[LumpStrokes],
    force_map: bytes,
    noise: str = "typical",
    seed: int = 1,
    step: Callable[[str], None] | None = None,
) -> pd.DataFrame:
    """Models learnt from ever more of the first three quarters of the lumps, asked about the last quarter.

    Returns
    -------
    DataFrame
        Rows of `training.SolidStudy.row`, and `computed`, how many lumps the emulator knew.
    """
    known = 3 * len(lumps) // 4
    asked = observed(lumps[known:], noise, seed, force_map, known)
    rows = []
    for n in (known // 8, known // 4, known // 2, known):
        own = lumps[:n]
        trained = train(taught(fit_emulator(own), own, noise, seed, force_map))
        # of the width the sizes of errors are learnt; only computed lumps make intervals of them
        said = replace(trained.study(asked, with_press=True), width_half=None)
        rows.append({"computed": n, **said.row(f"{n} lumps computed")})
        if step:
            step(f"learnt from {n} lumps")
    return pd.DataFrame(rows)


def table_of(asked: Observed, study: SolidStudy) -> pd.DataFrame:
    """Rows by d and h, then hard and soft: the share found, median errors, coverage.

    Parameters
    ----------
    asked : Observed
        All strokes, those that found nothing too.
    study : SolidStudy
        What was said of those that found a lump.

    Returns
    -------
    DataFrame
        lumps; found; d_error, depth_error, E_fat_error, hard_soft and d_covered of those found.
    """
    rows = [_row(words, asked.take(pick(asked)), study, pick(study.seen)) for words, pick in _classes(asked)]
    return pd.DataFrame(rows)


Pick = Callable[[Observed], NDArray[np.bool_]]


def _classes(asked: Observed) -> list[tuple[str, Pick]]:
    """Words of each class, and which strokes are of it."""
    ends = {name: np.quantile(_value(asked, name), np.linspace(0, 1, PARTS + 1)) for name in _BY}
    out: list[tuple[str, Pick]] = [("all", lambda seen: np.ones(len(seen.X), bool))]
    for i, j in product(range(PARTS), repeat=2):
        (d, d_end), (h, h_end) = (ends[name][k : k + 2] for name, k in zip(_BY, (i, j)))
        words = f"d {d:.0f} to {d_end:.0f} mm, h {h:.1f} to {h_end:.1f}"
        out.append((words, partial(_in_class, ends, (i, j))))
    out.append(("hard", lambda seen: seen.truth[:, E_INV23] <= HARD_BELOW))
    out.append(("soft", lambda seen: seen.truth[:, E_INV23] > HARD_BELOW))
    out.append(("beside the line", lambda seen: seen.across[:, 1] > 0))
    return out


_BY = ("d", "h")


def _value(seen: Observed, name: str) -> Floats:
    d, depth = (np.exp(seen.of(of)) for of in ("ln d", "ln depth"))
    return d if name == "d" else depth / d


def _in_class(ends: dict[str, Floats], which: tuple[int, int], seen: Observed) -> NDArray[np.bool_]:
    inside = np.ones(len(seen.X), bool)
    for name, k in zip(_BY, which):
        part = np.searchsorted(ends[name][1:-1], _value(seen, name), side="right")
        inside &= part == k
    return inside


def _row(words: str, asked: Observed, study: SolidStudy, rows: NDArray[np.bool_]) -> dict[str, object]:
    y, Y, half, hard = study.y[rows], study.seen.truth[rows], study.half[rows], study.hard[rows]
    error = np.median(np.abs(y - Y), axis=0) if len(y) else np.full(len(OUTPUTS), np.nan)
    d, h, fat = (OUTPUTS.index(name) for name in ("ln d", "ln h", "ln E_fat"))
    deep = np.abs((y - Y)[:, [d, h]].sum(1))
    return {
        "lumps of this kind": words,
        "lumps": len(np.unique(asked.group)),
        "found": float(asked.found.mean()) if len(asked.found) else float("nan"),
        "d_error": float(np.expm1(error[d])),
        "depth_error": float(np.expm1(np.median(deep))) if len(deep) else float("nan"),
        "E_fat_error": float(np.expm1(error[fat])),
        "hard_soft": float((hard == (Y[:, E_INV23] <= HARD_BELOW)).mean()) if len(y) else np.nan,
        "d_covered": float((np.abs(y - Y) <= half)[:, d].mean()) if len(y) else float("nan"),
    }


def text_of(result: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Heads and rows: shares and errors in %."""
    heads = ["lumps of this kind", "lumps", "found", "d", "depth", "E_fat", "hard/soft", "d's interval holds"]
    shares = ("found", "d_error", "depth_error", "E_fat_error", "hard_soft", "d_covered")
    rows = [
        [str(row["lumps of this kind"]), str(row["lumps"]), *(_percent(float(row[name])) for name in shares)]
        for row in result.to_dict("records")
    ]
    return heads, rows


def _percent(value: float) -> str:
    return "" if np.isnan(value) else f"{100 * value:.0f} %"


def tables(asked: Asked) -> list[StudyTable]:
    """Kinds of lumps, what the images allow, and learning from ever more lumps."""
    lumps, noise, seed = read_solids(asked.directory), asked.noise or "typical", asked.seed
    force_map = force_map_of(lumps)
    kinds = classes_of(lumps, force_map, noise, seed, os.cpu_count() or 1, asked.tell)
    emulator = fit_emulator(lumps)
    # the first ones, since any part of a Sobol sequence but its beginning is no fair sample
    some = [bound_emulated.emulated_bound(emulator, lump, noise) for lump in lumps[:BOUNDED]]
    bounds = bound_emulated.table_of(some)
    asked.tell("bounds worked out")
    learnt = learning_of(lumps, force_map, noise, seed, asked.tell)
    return [
        StudyTable(f"Balls and ellipsoids, noise {noise}", *text_of(kinds), kinds),
        StudyTable("Least median error that the images allow", *bound_emulated.text_of(bounds), bounds),
        StudyTable("Learnt from ever more lumps", *outputs_text(learnt, {}), learnt),
    ]
