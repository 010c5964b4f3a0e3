"""How far the solid mesh can be believed, docs/physics.md: python -m tests.benchmarks.solid_convergence
[whole | felupe]

One case with the sizes of the mesh halved one at a time, and with `whole` every element halved too
(8 times the elements, six gigabytes and minutes): of that it says what was wanted, and by how much it is
missed. The columns of the ball's middle give the features. With `felupe` the bump instead, by shells of
elements round the lump, in felupe and in ours, and the base.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from palpate.cli.simulate import over_the_lump
from palpate.features.map_features import stroke_features
from palpate.sim.tissue import Case, Settings, Stroke, simulate
from palpate.sim.tissue.one_thread import one_blas_thread
from palpate.sim.tissue.solid import grid, stroke
from palpate.sim.tissue.solid.stroke import forget_geometry

CODE = "d10h08e10f07_ball"
VARIANTS: dict[str, tuple[dict[str, Any], Settings]] = {
    "as it is": ({}, Settings()),
    "columns 1 mm": ({}, Settings(hx_mm=1.0)),
    "layers halved": ({"_LEAST_GAP_MM": 0.7}, Settings(layer_mm=1.5)),
    "rows halved": ({"_SKIN_MM": 0.75, "_ROW_GROWTH": 1.8, "_ROW_MM": 4.0}, Settings()),
    "two shells in the lump": ({"inner": 2}, Settings()),
    "four shells round the lump": ({"outer": 4}, Settings()),
    "tighter tolerance": ({}, Settings(tolerance=1e-7)),
}
WHOLE = {
    "columns 1 mm, layers / 4, rows / 2": (
        {"_LEAST_GAP_MM": 0.6, "_SKIN_MM": 0.75, "_ROW_GROWTH": 1.8, "_ROW_MM": 4.0},
        Settings(hx_mm=1.0, layer_mm=0.75),
    ),
    "everything halved": ({}, Settings(refine=2)),
}
SHELLS = (1, 2, 4)
WAY_MM = (-28.0, -20.0, -12.0, -6.0, 0.0)
COLUMNS = (
    "Base, kPa", "Amp, kPa", "Amp/Base", "Stdev, mm", "Curvature", "D28, mm", "D0, mm", "dip", "edge, kPa",
)  # fmt: skip
MIDDLE_ROWS = slice(6, 10)
WANTED_PERCENT = {
    "Base, kPa": 0.4,
    "Amp/Base": 2.0,
    "Stdev, mm": 2.0,
    "D28, mm": 0.4,
    "D0, mm": 0.4,
    "dip": 2.0,
}


@contextmanager
def sizes(values: dict[str, Any]) -> Iterator[None]:
    """The grid's constants, or numbers of shells in the grid laid, changed for a while."""
    shells = {name: value for name, value in values.items() if name in ("inner", "outer")}
    usual = {name: getattr(grid, name) for name in values if name not in shells}
    forget_geometry()
    try:
        for name in usual:
            setattr(grid, name, values[name])
        stroke.lay_grid = lambda *words: replace(grid.lay_grid(*words), **shells)
        yield
    finally:
        for name, value in usual.items():
            setattr(grid, name, value)
        stroke.lay_grid = grid.lay_grid
        forget_geometry()


def features(s: Stroke) -> list[float]:
    """In the order of COLUMNS: of the columns over the lump, and what the outermost reads before it."""
    found = stroke_features(over_the_lump(s)[0])
    bump = [found.base_kPa, found.amp_kPa, found.amp_kPa / found.base_kPa, found.stdev_mm]
    return [
        *bump,
        found.curvature,
        found.D28_mm,
        found.D0_mm,
        1 - found.D0_mm / found.D28_mm,
        float(s.images_kPa[0, MIDDLE_ROWS, -1].mean()),
    ]


def line(words: str, cells: list[str], nodes: object = "", cpu_s: str = "") -> None:
    print(f"| {words} | {nodes} | " + " | ".join(cells) + f" | {cpu_s} |", flush=True)


def main(whole: bool) -> None:
    line("mesh", list(COLUMNS), "nodes", "CPU s")
    print("|---" * (len(COLUMNS) + 3) + "|", flush=True)
    usual: list[float] = []
    percent: list[float] = []
    for words, (values, settings) in (VARIANTS | (WHOLE if whole else {})).items():
        with sizes(values):
            s = simulate(Case.from_code(CODE), settings)
        found = features(s)
        percent = [100 * (value / first - 1) for value, first in zip(found, usual or found)]
        cells = [f"{value:+.2f} %" for value in percent] if usual else [f"{value:.4f}" for value in found]
        usual = usual or found
        line(words, cells, f"{s.nodes:,}", f"{s.cpu_s:.1f}")
    if whole:
        wanted = [WANTED_PERCENT.get(name) for name in COLUMNS]
        line("wanted", ["" if most is None else f"{most} %" for most in wanted])
        over = [None if most is None else abs(value) - most for value, most in zip(percent, wanted)]
        line(
            "missed by", ["" if value is None else f"{value:.2f} %" if value > 0 else "met" for value in over]
        )


def felupe() -> None:
    """Base and bump over the ball's middle, kPa, on our mesh and on felupe's eight-node cells in it."""
    from tests.benchmarks.peers import felupe_solid

    case = Case.from_code(CODE)
    print("| shells | nodes | base, kPa | felupe | bump, kPa | felupe | felupe, CPU s |\n|" + "---|" * 7)
    for shells in SHELLS:
        with sizes({"outer": shells}):
            ours = simulate(case, Settings(), WAY_MM)
            felupe_solid.lay_grid = stroke.lay_grid
            with one_blas_thread():
                theirs = felupe_solid.run(case, Settings(), WAY_MM)
            felupe_solid.lay_grid = grid.lay_grid
        cells = [f"{ours.nodes:,}"]
        read = [images[:, MIDDLE_ROWS, 12:14].mean((1, 2)) for images in (ours.images_kPa, theirs.images_kPa)]
        for own, other in zip(*((before, over - before) for before, *_, over in read)):
            cells += [f"{own:.4f}", f"{100 * (other / own - 1):+.1f} %"]
        print(f"| {shells} | " + " | ".join(cells) + f" | {theirs.cpu_s:.0f} |", flush=True)


if __name__ == "__main__":
    if "felupe" in sys.argv[1:]:
        felupe()
    else:
        main("whole" in sys.argv[1:])
