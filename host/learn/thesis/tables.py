"""The thesis kind's tables for a terminal: Table 1 with the thesis' numbers beside ours, equations, tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from rich import box
from rich.table import Table

from palpate.learn.table import HARD_FROM, SHOWN
from palpate.learn.tables import shown
from palpate.learn.thesis.direct import DirectEquation, PermutationTest
from palpate.learn.thesis.forward import ForwardEquation, OneFactorCurve
from palpate.learn.thesis.strain import StrainForce


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

    @property
    def thesis_star(self) -> bool:
        """Whether the thesis' (*), its best equation for this input, is the one with displacement."""
        return (self.thesis_displacement or 0.0) > (self.thesis_pressure or 0.0)

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

    @property
    def thesis_star(self) -> bool:
        """Whether the thesis marks it as the equation to use."""
        return self.displacement == self.row.thesis_star


STAR_FROM = 0.005
"""R2 left out that the displacement must bring to be marked (*): a sensor that brings less is not needed."""


def stars(entries: list[Table1Entry]) -> list[bool]:
    """Which of `entries` are ours to use, one of each row: with displacement where it helps, left out."""
    out = []
    for pressure, both in zip(entries[::2], entries[1::2]):
        helps = both.direct.r2_loo > pressure.direct.r2_loo + STAR_FROM
        out += [not helps, helps]
    return out


def _shown(value: float | None, star: bool = False) -> str:
    return "-" if value is None else f"{value:.3f}" + " *" * star


def table_1(entries: list[Table1Entry]) -> Table:
    """Narrow enough for a terminal of 80 columns."""
    title = "Table 1: R2 of the inverse models (thesis beside ours)"
    out = Table(title=title, title_justify="left", caption_justify="left", box=box.SIMPLE_HEAD)
    out.padding = (0, 1, 0, 0)
    for name in ("", "from"):
        out.add_column(name, no_wrap=True)
    for name in ("n", "thesis", "in sample", "left out", "inverted", "left out"):
        out.add_column(name, justify="right", no_wrap=True)
    for e, star in zip(entries, stars(entries)):
        first = ("", "p, D") if e.displacement else (e.row.name, "p")
        values = (
            _shown(e.thesis_r2, e.thesis_star),
            _shown(e.direct.r2_in),
            _shown(e.direct.r2_loo, star),
            _shown(e.inverted_in),
            _shown(e.inverted_loo),
        )
        out.add_row(*first, str(e.n), *values, end_section=e.displacement)
    out.caption = (
        "p: from pressure; p, D: and displacement. left out: leave-one-out, terms chosen again each time; "
        "inverted: forward quadratics solved. *: the equation to use, the thesis' and ours"
    )
    return out


_whole = partial(shown, text=("equation", "curve", "runs", "target", "from", "transform of E"), no_wrap=True)


def inverse_table(entries: list[Table1Entry]) -> Table:
    """The direct equations of Appendix C."""
    rows = []
    for e in entries:
        d, kind = e.direct, "with displacement" if e.displacement else "pressure"
        errors = f"{d.rmse_in:.3g}", f"{d.rmse_loo:.3g}"
        inflated = f"{d.table['VIF'].max():.1f}", f"{d.runs['cook'].max():.2f}"
        rows.append([f"{e.row.name}, {kind}", d.text(), *errors, *inflated])
    caption = "RMSE in sample and left out; the largest variance inflation factor and Cook's distance"
    heads = ("runs", "equation", "RMSE", "left out", "VIF", "Cook")
    return _whole("Inverse model (Appendix C)", heads, rows, show_lines=True, caption=caption)


def forward_table(equations: Mapping[str, ForwardEquation]) -> Table:
    """The combined equations of Appendix B."""
    rows = [
        [e.text(), f"{e.r2:.4f}", f"{e.r2_adjusted:.4f}", e.wrong_way_text() or "-"]
        for e in equations.values()
    ]
    heads = ("equation", "R2", "adjusted", "against physics")
    out = _whole("Forward model (Appendix B)", heads, rows, show_lines=True)
    out.caption = (
        "against physics: share of the runs' range in which the output goes the wrong way with that input; "
        "do not use the equation there"
    )
    return out


def one_factor_table(curves: Sequence[OneFactorCurve]) -> Table:
    """One output against one input, all others as in the reference case."""
    rows = [[c.text(), f"{c.r2:.4f}", c.without_text()] for c in curves]
    out = _whole("One factor at a time (Figures 13, 14)", ("equation", "R2", "without one run"), rows)
    out.caption = "without one run: the exponent, or slope, without the run that it depends on most"
    return out


def strain_force_table(curves: Sequence[StrainForce]) -> Table:
    """F = A S^B of each lump that was pressed with two forces or more."""
    rows = [[c.label, c.text(), f"{c.r2:.4f}"] for c in curves]
    return _whole("Strain over the lump and force (Figures 15, 16)", ("runs", "curve", "R2"), rows)


def transforms_table(transforms: pd.DataFrame) -> Table:
    """Which transform of E is the straightest (`forward.stiffness_transforms`)."""
    rows = [
        [r["transform"], f"{r['r2']:.3f}", f"{r['largest_leverage']:.2f}"]
        for r in transforms.to_dict("records")
    ]
    return _whole("Why E^-2/3", ("transform of E", "R2 of Amp, one factor", "largest leverage"), rows)


def permutation_table(tests: Sequence[PermutationTest]) -> Table:
    """The permutation tests."""
    rows = [
        [
            SHOWN[t.target],
            "p, D" if t.displacement else "p",
            f"{t.r2:.3f}",
            f"{t.r2_by_chance:.3f}",
            f"{t.P:.3f}",
        ]
        for t in tests
    ]
    heads = ("target", "from", "R2", "by chance, 95 % below", "P")
    return _whole("Could it be chance? Targets shuffled among the runs, terms chosen again", heads, rows)


def entry_dict(entry: Table1Entry, star: bool) -> dict[str, Any]:
    """An entry as plain numbers for JSON."""
    d = entry.direct
    return {
        "row": entry.row.name,
        "with_displacement": entry.displacement,
        "n": entry.n,
        "thesis_r2": entry.thesis_r2,
        "thesis_star": entry.thesis_star,
        "star": star,
        "r2_in": d.r2_in,
        "r2_nested_loo": d.r2_loo,
        "inverted_r2_in": entry.inverted_in,
        "inverted_r2_loo": entry.inverted_loo,
        "rmse_in": d.rmse_in,
        "rmse_loo": d.rmse_loo,
        "r2_adjusted": d.r2_adjusted,
        "equation": d.text(),
        "terms": terms_of(d.table),
        "runs": d.runs.to_dict("records"),
    }


def terms_of(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a coefficient table; the intercept has no VIF."""
    records = table.reset_index(names="term").to_dict("records")
    return [
        {str(k): None if isinstance(v, float) and np.isnan(v) else v for k, v in r.items()} for r in records
    ]
