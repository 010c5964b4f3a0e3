"""The table of runs from simulated strokes (thesis, Appendix A)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from os import PathLike
from pathlib import Path

import pandas as pd

from palpate.features.map_features import stroke_features
from palpate.learn.table import TableError
from palpate.sim.tissue import THESIS_CODES, Stroke, load_strokes


def features_table(strokes: Iterable[Stroke], method: int = 2, increment_mm: float = 1.0) -> pd.DataFrame:
    """One row a stroke: what went in, features in float64, nominal strains (see `learn.table`)."""
    rows = []
    for stroke in strokes:
        case, features = stroke.case, stroke_features(stroke, method, increment_mm)
        far, over = features.strain(case.t_mm)
        rows.append(
            {
                "code": stroke.code,
                "d_mm": case.d_mm,
                "h": case.h,
                "E_ratio": case.E_ratio,
                "F_rel": case.F_rel,
                "t_mm": case.t_mm,
                "linear": not case.nonlinear_lump,
                **asdict(features),
                "strain_28": far,
                "strain_0": over,
            }
        )
    return pd.DataFrame(rows)


def read_strokes(directory: str | PathLike[str]) -> list[Stroke]:
    """All strokes of a sweep's directory; `TableError` if there are none."""
    strokes = list(load_strokes(Path(directory)))
    if not strokes:
        raise TableError(
            f"{directory} holds no finished strokes; run: palpate sweep --design thesis --out {directory}"
        )
    return strokes


def thesis_strokes(strokes: Sequence[Stroke]) -> list[Stroke]:
    """The thirty strokes of the thesis, in its order; `TableError` names those that are missing."""
    have = {stroke.code: stroke for stroke in strokes}
    missing = [code for code in THESIS_CODES if code not in have]
    if missing:
        raise TableError(
            f"{len(missing)} of the thesis' runs are not in the sweep; the first is {missing[0]}"
        )
    return [have[code] for code in THESIS_CODES]
