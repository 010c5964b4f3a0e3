"""The thesis kind's equations and tests as tables for a terminal; Table 1 itself is in `table_1`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import pandas as pd
from rich.table import Table

from palpate.learn.table import SHOWN
from palpate.learn.tables import shown
from palpate.learn.thesis.direct import PermutationTest
from palpate.learn.thesis.forward import ForwardEquation, OneFactorCurve
from palpate.learn.thesis.strain import StrainForce

_shown = partial(shown, text=("equation", "curve", "runs", "target", "from", "transform of E"), no_wrap=True)


def forward_table(equations: Mapping[str, ForwardEquation]) -> Table:
    """The combined equations of Appendix B."""
    rows = [
        [e.text(), f"{e.r2:.4f}", f"{e.r2_adjusted:.4f}", e.wrong_way_text() or "-"]
        for e in equations.values()
    ]
    heads = ("equation", "R2", "adjusted", "against physics")
    out = _shown("Forward model (Appendix B)", heads, rows, show_lines=True)
    out.caption = (
        "against physics: share of the runs' range in which the output goes the wrong way with that input; "
        "do not use the equation there"
    )
    return out


def one_factor_table(curves: Sequence[OneFactorCurve]) -> Table:
    """One output against one input, all others as in the reference case."""
    rows = [[c.text(), f"{c.r2:.4f}", c.without_text()] for c in curves]
    out = _shown("One factor at a time (Figures 13, 14)", ("equation", "R2", "without one run"), rows)
    out.caption = "without one run: the exponent, or slope, without the run that it depends on most"
    return out


def strain_force_table(curves: Sequence[StrainForce]) -> Table:
    """F = A S^B of each lump that was pressed with two forces or more."""
    rows = [[c.label, c.text(), f"{c.r2:.4f}"] for c in curves]
    return _shown("Strain over the lump and force (Figures 15, 16)", ("runs", "curve", "R2"), rows)


def transforms_table(transforms: pd.DataFrame) -> Table:
    """Which transform of E is the straightest (`forward.stiffness_transforms`)."""
    rows = [
        [r["transform"], f"{r['r2']:.3f}", f"{r['largest_leverage']:.2f}"]
        for r in transforms.to_dict("records")
    ]
    return _shown("Why E^-2/3", ("transform of E", "R2 of Amp, one factor", "largest leverage"), rows)


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
    return _shown("Could it be chance? Targets shuffled among the runs, terms chosen again", heads, rows)
