"""The thesis' models from its thirty runs: `fit_thesis` gives Table 1 beside the thesis' numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from rich import box
from rich.table import Table

from host.regression.direct import DirectEquation, fit_direct, permutation_test
from host.regression.forward import (
    ONE_FACTOR,
    ForwardEquation,
    OneFactorCurve,
    forward_model,
    one_factor_curve,
    stiffness_transforms,
)
from host.regression.inverted import inverted_estimates
from host.regression.strain import StrainForce, curves_by
from host.regression.table import (
    DISPLACEMENT,
    HARD_FROM,
    PRESSURE,
    SHOWN,
    TARGETS,
    check_table,
    r_squared,
    target_values,
)


@dataclass(frozen=True)
class Table1Row:
    """One row of Table 1: its name, its target, which runs, and the thesis' R2 (None where it gives none)."""

    target: str
    runs: str
    thesis_pressure: float | None
    thesis_displacement: float | None

    @property
    def name(self) -> str:
        """As the thesis prints it."""
        suffix = {"all": "", "hard": " (E >= 10)", "soft": " (E < 10)"}[self.runs]
        return SHOWN[self.target] + suffix

    def thesis(self, displacement: bool) -> float | None:
        """The thesis' R2."""
        return self.thesis_displacement if displacement else self.thesis_pressure

    def rows(self, table: pd.DataFrame) -> np.ndarray:
        """Which runs of `table` it is fitted to."""
        hard = (table["E_ratio"] >= HARD_FROM).to_numpy()
        return {"all": np.ones(len(table), bool), "hard": hard, "soft": ~hard}[self.runs]


TABLE_1 = (
    Table1Row("F", "all", 0.999, None),
    Table1Row("t", "all", 0.810, 0.990),
    Table1Row("d", "all", 0.790, 0.925),
    Table1Row("d", "hard", 0.920, 0.966),
    Table1Row("h", "all", 0.824, 0.800),
    Table1Row("h", "hard", 0.957, 0.882),
    Table1Row("E_inv23", "all", 0.649, 0.724),
    Table1Row("E_inv23", "soft", 0.960, 0.981),
)

NESTED_TARGETS = {"F": 0.999, "t": 0.99, "d": 0.98, "h": 0.97, "E_inv23": 0.92}
"""Leave-one-out R2 that pressure with displacement should reach."""


@dataclass(frozen=True)
class Table1Entry:
    """A row of Table 1 with pressure only, or with displacement.

    Attributes
    ----------
    row : Table1Row
    displacement : bool
    n : int
        Runs it is fitted to.
    direct : DirectEquation
        The chosen equation with in-sample and nested leave-one-out R2.
    inverted_in, inverted_loo : float
        R2 of the inverted forward model on the same runs.
    """

    row: Table1Row
    displacement: bool
    n: int
    direct: DirectEquation
    inverted_in: float
    inverted_loo: float

    @property
    def thesis_r2(self) -> float | None:
        """The number that it stands beside."""
        return self.row.thesis(self.displacement)


@dataclass(frozen=True)
class ThesisFit:
    """Everything of the thesis kind; `report` draws it, `to_dict` is its JSON."""

    table: pd.DataFrame
    entries: list[Table1Entry]
    inverted: dict[str, pd.DataFrame]
    curves: list[OneFactorCurve]
    forward: dict[str, ForwardEquation]
    strain_force: list[StrainForce]
    transforms: pd.DataFrame
    permutation: dict[str, float]

    def entry(self, target: str, runs: str, displacement: bool) -> Table1Entry:
        """One entry of Table 1."""
        for entry in self.entries:
            if (entry.row.target, entry.row.runs, entry.displacement) == (target, runs, displacement):
                return entry
        raise KeyError((target, runs, displacement))

    def tables(self) -> list[Table]:
        """What `palpate fit --kind thesis` prints."""
        return [_table_1(self.entries), _forward_table(self), _inverse_table(self.entries)]

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return {
            "table_1": [_entry_dict(entry) for entry in self.entries],
            "forward": {k: _equation_dict(e) for k, e in self.forward.items()},
            "one_factor": [{"equation": c.text(), "r2": c.r2} for c in self.curves],
            "strain_force": [{"runs": c.label, "A": c.A, "B": c.B, "r2": c.r2} for c in self.strain_force],
            "stiffness_transforms": self.transforms.to_dict("records"),
            "permutation_P": self.permutation,
        }


def fit_thesis(features_table: pd.DataFrame, permutations: int = 99) -> ThesisFit:
    """Fit forward and inverse models of the thesis to its runs.

    Parameters
    ----------
    features_table : DataFrame
        Of `runs.features_table`; the nonlinear run is left out of every equation, as in the thesis.
    permutations : int
        Shuffles of the permutation test of each target with all features; 0 leaves the test out.

    Raises
    ------
    TableError
        A column, a number or the reference case is missing.
    """
    table = check_table(features_table[features_table["linear"].astype(bool)])
    truth = target_values(table)
    inverted = {}
    for name, features in (("pressure", PRESSURE), ("displacement", PRESSURE + DISPLACEMENT)):
        inverted[name] = inverted_estimates(table, features)
        inverted[f"{name}_loo"] = inverted_estimates(table, features, leave_one_out=True)
    entries = []
    for row in TABLE_1:
        use = row.rows(table)
        for displacement in (False, True):
            kind = "displacement" if displacement else "pressure"
            y = truth[row.target].to_numpy()[use]
            entries.append(
                Table1Entry(
                    row,
                    displacement,
                    int(use.sum()),
                    fit_direct(table, row.target, displacement, use),
                    r_squared(y, inverted[kind][row.target].to_numpy()[use]),
                    r_squared(y, inverted[f"{kind}_loo"][row.target].to_numpy()[use]),
                )
            )
    luck = {t: permutation_test(table, t, False, permutations)[0] for t in TARGETS} if permutations else {}
    return ThesisFit(
        table,
        entries,
        inverted,
        [one_factor_curve(table, output, varied) for output, varied in ONE_FACTOR],
        forward_model(table),
        curves_by(table, ("d_mm", "h", "E_ratio")),
        stiffness_transforms(table),
        luck,
    )


def _shown(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _table_1(entries: list[Table1Entry]) -> Table:
    """Narrow enough for a terminal of 80 columns."""
    title = "Table 1: R2 of the inverse models (thesis beside ours)"
    out = Table(title=title, title_justify="left", caption_justify="left", box=box.SIMPLE_HEAD)
    out.padding = (0, 1, 0, 0)
    for name in ("", "from"):
        out.add_column(name, no_wrap=True)
    for name in ("n", "thesis", "in sample", "left out", "inverted", "left out"):
        out.add_column(name, justify="right", no_wrap=True)
    for e in entries:
        values = (e.thesis_r2, e.direct.r2_in, e.direct.r2_loo, e.inverted_in, e.inverted_loo)
        first = ("", "p, D") if e.displacement else (e.row.name, "p")
        out.add_row(*first, str(e.n), *map(_shown, values), end_section=e.displacement)
    out.caption = (
        "p: from pressure; p, D: and displacement. left out: leave-one-out, terms chosen anew each time; "
        "inverted: forward quadratics solved"
    )
    return out


def _forward_table(fit: ThesisFit) -> Table:
    out = Table(title="Forward model (Appendix B)", show_lines=True)
    for name in ("equation", "R2", "adjusted"):
        out.add_column(name, justify="left" if name == "equation" else "right")
    for equation in fit.forward.values():
        out.add_row(equation.text(), f"{equation.r2:.4f}", f"{equation.r2_adjusted:.4f}")
    return out


def _inverse_table(entries: list[Table1Entry]) -> Table:
    out = Table(title="Inverse model (Appendix C)", show_lines=True)
    for name in ("runs", "equation"):
        out.add_column(name)
    for name in ("RMSE", "left out", "VIF", "Cook"):
        out.add_column(name, justify="right", no_wrap=True)
    out.caption = "RMSE in sample and left out; the largest variance inflation factor and Cook's distance"
    for e in entries:
        d = e.direct
        kind = "with displacement" if e.displacement else "pressure"
        out.add_row(
            f"{e.row.name}, {kind}",
            d.text(),
            f"{d.rmse_in:.3g}",
            f"{d.rmse_loo:.3g}",
            f"{d.table['VIF'].max():.1f}",
            f"{d.runs['cook'].max():.2f}",
        )
    return out


def _equation_dict(equation: ForwardEquation) -> dict[str, Any]:
    return {
        "equation": equation.text(),
        "r2": equation.r2,
        "r2_adjusted": equation.r2_adjusted,
        "terms": _terms(equation.table),
        "dropped": [dict(zip(("term", "P", "r2", "r2_adjusted"), step)) for step in equation.steps],
    }


def _entry_dict(entry: Table1Entry) -> dict[str, Any]:
    d = entry.direct
    return {
        "row": entry.row.name,
        "with_displacement": entry.displacement,
        "n": entry.n,
        "thesis_r2": entry.thesis_r2,
        "r2_in": d.r2_in,
        "r2_nested_loo": d.r2_loo,
        "inverted_r2_in": entry.inverted_in,
        "inverted_r2_loo": entry.inverted_loo,
        "rmse_in": d.rmse_in,
        "rmse_loo": d.rmse_loo,
        "r2_adjusted": d.r2_adjusted,
        "equation": d.text(),
        "terms": _terms(d.table),
        "runs": d.runs.to_dict("records"),
    }


def _terms(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a coefficient table; the intercept has no VIF."""
    records = table.reset_index(names="term").to_dict("records")
    return [
        {str(k): None if isinstance(v, float) and np.isnan(v) else v for k, v in r.items()} for r in records
    ]
