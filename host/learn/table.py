"""The runs as a table: what went in, what came out, and the coordinates the regressions work in.

Columns, one row a run: code, d_mm, h, E_ratio, F_rel, t_mm, linear (bool), and the features base_kPa,
amp_kPa, stdev_mm, curvature, D28_mm, D0_mm. As in the thesis every feature is taken relative to the
reference case before it enters an equation ("relative values are the only ones used").
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from firmware_py import outputs
from palpate.errors import PalpateError
from palpate.features.map_features import Floats
from palpate.model_export.vocabulary import OUTPUTS, SYMBOLS
from palpate.sim.tissue.case import Case

REFERENCE_CODE = "d10h08e10f10"
INPUTS = ("d_mm", "h", "E_ratio", "F_rel", "t_mm")
FEATURES = ("base_kPa", "amp_kPa", "stdev_mm", "curvature", "D28_mm", "D0_mm")
HARD_FROM = 10.0
"""Stiffness ratio from which the thesis calls a lump hard."""

PRESSURE = ("Base", "Amp", "Stdev", "iCurv")
DISPLACEMENT = ("D28", "dip")
NAMES = {
    "Base": "ln Base",
    "Amp": "ln(Amp/Base)",
    "Stdev": "ln Stdev",
    "iCurv": "1/Curv - 1",
    "D28": "ln D28",
    "dip": "1 - D0/D28",
}
TARGETS = SYMBOLS[: outputs.E_FAT]
"""What a model estimates that is told its tissue; it repeats E_fat, the last output."""
SHOWN = {target: {"E_inv23": "E^-2/3"}.get(target, target) for target in TARGETS}
_STIFFEST = 1000.0 ** (-2 / 3)
INPUT_COLUMN = {"F": "F_rel", "t": "t_mm", "d": "d_mm", "h": "h"}
SYMBOL_OF = {column: symbol for symbol, column in INPUT_COLUMN.items()} | {"E_ratio": "E"}


class TableError(PalpateError):
    """The table of runs does not hold what the regression needs."""


def check_table(table: pd.DataFrame) -> pd.DataFrame:
    """The table with its rows renumbered; `TableError` names what is missing or not finite."""
    missing = [name for name in ("code", "linear", *INPUTS, *FEATURES) if name not in table]
    if missing:
        raise TableError(f"the table of runs has no column {', '.join(missing)}")
    broken = ~np.isfinite(table[list(FEATURES)].to_numpy(float)).all(axis=1)
    if broken.any():
        raise TableError(f"the run {table['code'][broken].iloc[0]} holds a feature that is not a number")
    if REFERENCE_CODE not in set(table["code"]):
        raise TableError(f"the reference case {REFERENCE_CODE} is not among the runs")
    return table.reset_index(drop=True)


def relative(table: pd.DataFrame) -> pd.DataFrame:
    """The six features over those of the reference case (thesis, Appendix A)."""
    reference = table.loc[table["code"] == REFERENCE_CODE, list(FEATURES)].iloc[0].astype(float)
    return table[list(FEATURES)].astype(float) / reference


def coordinates(table: pd.DataFrame) -> pd.DataFrame:
    """Features as the regressions take them: logs of relative values, 1/Curvature, the dip.

    1/Curvature regresses better than its log; it stays finite where the edge of the face lifts off.
    """
    r = relative(table)
    return pd.DataFrame(
        {
            "Base": np.log(r["base_kPa"]),
            "Amp": np.log(np.maximum(r["amp_kPa"], 1e-4) / r["base_kPa"]),
            "Stdev": np.log(r["stdev_mm"]),
            "iCurv": 1 / r["curvature"] - 1,
            "D28": np.log(r["D28_mm"]),
            "dip": 1 - table["D0_mm"] / table["D28_mm"],
        }
    )


def target_values(table: pd.DataFrame) -> pd.DataFrame:
    """What the inverse models estimate, in the thesis' terms: F, t (mm), d (mm), h, E^-2/3."""
    values = {name: table[column].astype(float) for name, column in INPUT_COLUMN.items()}
    values["E_inv23"] = table["E_ratio"].astype(float) ** (-2 / 3)
    F, d, h, E_inv23 = (np.asarray(values[name], float) for name in ("F", "d", "h", "E_inv23"))
    return pd.DataFrame({**values, **further_outputs(F, d, h, E_inv23)}, table.index)[list(TARGETS)]


def further_outputs(F_rel: Floats, d_mm: Floats, h: Floats, E_inv23: Floats) -> dict[str, Floats]:
    """The outputs (n) that the thesis did not have, by symbol, of lumps with these inputs (n)."""
    names = {s: name for s, (name, _) in zip(TARGETS, OUTPUTS) if s not in (*INPUT_COLUMN, "E_inv23")}
    if not names:
        return {}
    E_ratio = np.maximum(E_inv23, _STIFFEST) ** -1.5
    cases = [Case(*inputs) for inputs in zip(d_mm, h, E_ratio, F_rel)]
    return {s: np.array([getattr(case, name) for case in cases], float) for s, name in names.items()}


def r_squared(truth: Sequence[float] | Floats, estimate: Sequence[float] | Floats) -> float:
    """1 - residual over total sum of squares of truth and estimate (n), about the mean of the truth given."""
    y, p = np.asarray(truth, float), np.asarray(estimate, float)
    return float(1 - np.sum((y - p) ** 2) / np.sum((y - y.mean()) ** 2))


def rmse(truth: Sequence[float] | Floats, estimate: Sequence[float] | Floats) -> float:
    """Root mean square of estimate - truth, both (n), in their unit."""
    return float(np.sqrt(np.mean((np.asarray(truth, float) - np.asarray(estimate, float)) ** 2)))
