"""The thesis' models from its thirty runs: `fit_thesis` gives Table 1 beside the thesis' numbers."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import pandas as pd
from rich.table import Table

from palpate.errors import UsageError
from palpate.learn.table import DISPLACEMENT, PRESSURE, TARGETS, check_table, r_squared, target_values
from palpate.learn.thesis.direct import PermutationTest, fit_direct, permutation_test
from palpate.learn.thesis.forward import (
    ONE_FACTOR,
    ForwardEquation,
    OneFactorCurve,
    forward_model,
    one_factor_curve,
    stiffness_transforms,
)
from palpate.learn.thesis.inverted import inverted_estimates
from palpate.learn.thesis.strain import StrainForce, curves_by
from palpate.learn.thesis.tables import (
    TABLE_1,
    Table1Entry,
    entry_dict,
    forward_table,
    inverse_table,
    one_factor_table,
    permutation_table,
    stars,
    strain_force_table,
    table_1,
    terms_of,
    transforms_table,
)
from palpate.progress import ProgressCallback


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
    permutation: list[PermutationTest]

    def entry(self, target: str, runs: str, displacement: bool) -> Table1Entry:
        """One entry of Table 1."""
        for entry in self.entries:
            if (entry.row.target, entry.row.runs, entry.displacement) == (target, runs, displacement):
                return entry
        raise UsageError(f"Table 1 has no row for {target} and {runs}")

    def tables(self) -> list[Table]:
        """What `palpate fit --kind thesis` prints."""
        out = [table_1(self.entries), forward_table(self.forward), inverse_table(self.entries)]
        out += [one_factor_table(self.curves), strain_force_table(self.strain_force)]
        out.append(transforms_table(self.transforms))
        return [*out, permutation_table(self.permutation)] if self.permutation else out

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return {
            "table_1": [entry_dict(*one) for one in zip(self.entries, stars(self.entries))],
            "forward": {k: _equation_dict(e) for k, e in self.forward.items()},
            "one_factor": [
                {
                    "equation": c.text(),
                    "r2": c.r2,
                    "b": c.b,
                    "b_without": c.b_without,
                    "x_without": c.x_without,
                }
                for c in self.curves
            ],
            "strain_force": [{"runs": c.label, "A": c.A, "B": c.B, "r2": c.r2} for c in self.strain_force],
            "stiffness_transforms": self.transforms.to_dict("records"),
            "permutation": [asdict(test) for test in self.permutation],
        }


def fit_thesis(
    features_table: pd.DataFrame, permutations: int = 199, progress: ProgressCallback | None = None
) -> ThesisFit:
    """Fit forward and inverse models of the thesis to its runs.

    Parameters
    ----------
    features_table : DataFrame
        Of `runs.features_table`; the nonlinear run is left out of every equation, as in the thesis.
    permutations : int
        Shuffles of each target in the permutation tests; 0 leaves these out.
    progress : callable, optional
        See `progress.ProgressCallback`.

    Raises
    ------
    TableError
        A column, a number or the reference case is missing.
    """
    table = check_table(features_table[features_table["linear"].astype(bool)])
    truth = target_values(table)
    say = progress or (lambda what, done, total: None)
    inverted = {}
    for k, (name, features) in enumerate((("pressure", PRESSURE), ("displacement", PRESSURE + DISPLACEMENT))):
        say("forward models inverted", k, 2)
        inverted[name] = inverted_estimates(table, features)
        inverted[f"{name}_loo"] = inverted_estimates(table, features, leave_one_out=True)
    say("forward models inverted", 2, 2)
    entries: list[Table1Entry] = []
    for row in TABLE_1:
        use = row.rows(table)
        for displacement in (False, True):
            kind = "displacement" if displacement else "pressure"
            y = truth[row.target].to_numpy()[use]
            say("rows of Table 1, each run left out", len(entries), 2 * len(TABLE_1))
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
    say("rows of Table 1, each run left out", len(entries), 2 * len(TABLE_1))
    permutation: list[PermutationTest] = []
    tests = [(target, displacement) for target in TARGETS for displacement in (False, True)]
    for target, displacement in tests if permutations else ():
        permutation.append(permutation_test(table, target, displacement, permutations))
        say("targets shuffled", len(permutation), len(tests))
    return ThesisFit(
        table,
        entries,
        inverted,
        [one_factor_curve(table, output, varied) for output, varied in ONE_FACTOR],
        forward_model(table),
        curves_by(table, ("d_mm", "h", "E_ratio")),
        stiffness_transforms(table),
        permutation,
    )


def _equation_dict(equation: ForwardEquation) -> dict[str, Any]:
    return {
        "equation": equation.text(),
        "r2": equation.r2,
        "r2_adjusted": equation.r2_adjusted,
        "wrong_way": equation.wrong_way,
        "terms": terms_of(equation.table),
        "dropped": [dict(zip(("term", "P", "r2", "r2_adjusted"), step)) for step in equation.steps],
    }
