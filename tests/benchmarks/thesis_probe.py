"""The thesis' lost probe, docs/accuracy.md: python -m tests.benchmarks.thesis_probe

Strokes the thesis' 29 linear runs with one thing changed that the thesis does not give: the probe's radius,
the shape of its face, gland, sides, force, friction, and where Curvature and displacement are taken. Prints
what each does to the exponents of Figure 13 and to Table 1's rows of h. About ten minutes of CPU time.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from palpate.features.map_features import curvature
from palpate.learn.table import HARD_FROM, check_table
from palpate.learn.thesis.depth import CHOICES, linear_r2, two_kept
from palpate.learn.thesis.direct import fit_direct
from palpate.learn.thesis.forward import one_factor_curve
from palpate.learn.thesis.runs import features_table
from palpate.sim.tissue import THESIS_CODES, Case, Settings, Stroke, TissueError, simulate

LINEAR = tuple(code for code in THESIS_CODES if "NL" not in code)
CURVES = (
    ("curvature", "F_rel"),
    ("curvature", "t_mm"),
    ("amp_kPa", "F_rel"),
    ("amp_kPa", "h"),
    ("amp_kPa", "d_mm"),
    ("stdev_mm", "h"),
    ("stdev_mm", "d_mm"),
)
THESIS = (
    ["the thesis", "slight", "-1.1", "-0.55", *7 * ["-"]],
    ["the thesis", "0.824", "0.800", "-", "-", "-", "0.957", "0.882", "-", "-", "-"],
)


@dataclass(frozen=True)
class Variant:
    """One thing changed: fields of the case or the settings, or where the features are taken."""

    words: str
    case: dict[str, float] = field(default_factory=dict)
    settings: dict[str, float] = field(default_factory=dict)
    curvature_mm: float = 8.0
    far_mm: float = 28.0


def _face(radius_mm: float, half_mm: float, fillet: float = 0.1) -> dict[str, float]:
    return {"probe_radius_mm": radius_mm, "face_half_mm": half_mm, "fillet_per_mm2": fillet}


VARIANTS = (
    Variant("ours: R 40, rounded off beyond 10 mm by .1"),
    *(Variant(f"R {R:g}", {"probe_radius_mm": R}) for R in (25.0, 60.0, 80.0)),
    Variant("flat", {"probe_radius_mm": math.inf}),
    *(Variant(f"rounded off beyond {a:g} mm", {"face_half_mm": a}) for a in (6.0, 8.0, 15.0)),
    *(Variant(f"rounded off by {k:g}", {"fillet_per_mm2": k}) for k in (0.02, 0.3)),
    *(
        Variant(f"R {R:g}, beyond {a:g} mm by {k:g}", _face(R, a, k))
        for R, a, k in ((60.0, 6.0, 0.1), (60.0, 5.0, 0.1), (80.0, 5.0, 0.1), (80.0, 4.0, 0.05))
    ),
    Variant("flat, beyond 4 mm by .1", _face(math.inf, 4.0)),
    *(Variant(f"gland {g:g} mm", {"gland_mm": g}) for g in (11.0, 30.0)),
    *(Variant(f"gland {r:g} times the fat", {"gland_ratio": r}) for r in (3.0, 12.0, 100.0)),
    Variant("sides at -75 and 75 mm", settings={"left_mm": -75.0, "right_mm": 75.0}),
    Variant("sides at -300 and 300 mm", settings={"left_mm": -300.0, "right_mm": 300.0}),
    *(Variant(f"Poisson's ratio {nu:g}", {"poisson": nu}) for nu in (0.45, 0.4999)),
    *(Variant(f"F = 1 is {f:g} N/m", {"fat_kPa": 1000.0 / f}) for f in (50.0, 150.0)),
    Variant("friction .3", {"friction": 0.3}),
    *(Variant(f"Curvature at {s:g} mm", curvature_mm=s) for s in (5.0, 6.5, 10.0)),
    *(Variant(f"far is {x:g} mm", far_mm=x) for x in (20.0, 24.0)),
)


def table_of(variant: Variant, codes: Sequence[str] = LINEAR) -> tuple[pd.DataFrame, int]:
    """The runs' features under `variant`, named by the thesis' codes; and how many could not be stroked."""
    strokes: dict[str, Stroke] = {}
    settings = replace(Settings(), **variant.settings)
    for code in codes:
        try:
            strokes[code] = simulate(replace(Case.from_code(code), **variant.case), settings)
        except TissueError as error:
            print(f"{variant.words}, {code}: {error}", file=sys.stderr)
    table = features_table(strokes.values()).assign(code=list(strokes))
    far, at = -variant.far_mm, variant.curvature_mm
    table["curvature"] = [curvature(stroke, far, at) for stroke in strokes.values()]
    table["D28_mm"] = [
        np.interp(far, stroke.positions_mm, stroke.displacement_mm) for stroke in strokes.values()
    ]
    return check_table(table), len(codes) - len(strokes)


def exponents(table: pd.DataFrame) -> list[str]:
    """Curvature of the reference case, and the exponents of Figure 13; of Curvature with their R2."""
    cells = [f"{table.loc[table['code'] == LINEAR[0], 'curvature'].iloc[0]:.2f}"]
    for output, varied in CURVES:
        curve = one_factor_curve(table, output, varied)
        cells.append(f"{curve.b:.2f}" + (f" ({curve.r2:.2f})" if output == "curvature" else ""))
    D28 = np.log(table["D28_mm"])
    X = np.column_stack([np.ones(len(table)), np.log(table["F_rel"]), np.log(table["t_mm"])])
    return [*cells, *(f"{b:.2f}" for b in np.linalg.lstsq(X, D28, rcond=None)[0][1:])]


def depth_rows(table: pd.DataFrame) -> list[str]:
    """R2 of h, of all runs and of E >= 10: linear terms of `CHOICES`; then ours, in sample / left out."""
    every = np.ones(len(table), bool)
    cells = []
    for rows in (every, (table["E_ratio"] >= HARD_FROM).to_numpy()):
        cells += [f"{linear_r2(table, features, rows):.3f}" for features in CHOICES]
        chosen = [fit_direct(table, "h", displacement, rows) for displacement in (False, True)]
        cells += [f"{equation.r2_in:.3f} / {equation.r2_loo:.3f}" for equation in chosen]
    return cells


HEADS = (
    ("changed", "Curv", "Curv~F (R2)", "Curv~t (R2)", "Amp~F", "Amp~h", "Amp~d", "Stdev~h", "Stdev~d",
     "D28~F", "D28~t"),
    ("changed", *(f"{of}{kind}" for of in ("", "E >= 10: ") for kind in
                  ("p", "D instead", "p, D", "ours p", "ours p, D"))),
)  # fmt: skip


def main(*words: str) -> None:
    """Print both tables, of the variants that `words` name or of all."""
    tables = tuple([row] for row in THESIS)
    for variant in VARIANTS:
        if words and variant.words not in words:
            continue
        table, failed = table_of(variant)
        name = variant.words + (f" ({failed} runs failed)" if failed else "")
        for rows, cells in zip(tables, (exponents(table), depth_rows(table))):
            rows.append([name, *cells])
        print(" | ".join([*tables[0][-1], *tables[1][-1][1:]]), file=sys.stderr, flush=True)
    for heads, rows in zip(HEADS, tables):
        print("\n| " + " | ".join(heads) + " |\n|" + "---|" * len(heads))
        for row in rows:
            print("| " + " | ".join(row) + " |")
    print("\n| kept beside the displacements | R2 of h | E >= 10 |\n|---|---|---|")
    for kept, every, hard in two_kept(table_of(VARIANTS[0])[0]):
        print(f"| {kept} | {every:.3f} | {hard:.3f} |")


if __name__ == "__main__":
    main(*sys.argv[1:])
