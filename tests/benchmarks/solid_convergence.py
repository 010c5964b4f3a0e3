"""How far the solid mesh can be believed, docs/physics.md: python -m tests.benchmarks.solid_convergence
[whole]

One case with the sizes of the mesh halved one direction at a time, and with `whole` every element halved
too (8 times the elements, a few gigabytes and minutes). The columns of the ball's middle give the features.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from palpate.cli.simulate import over_the_lump
from palpate.features.map_features import stroke_features
from palpate.sim.tissue import Case, Settings, simulate
from palpate.sim.tissue.solid import grid
from palpate.sim.tissue.solid.stroke import forget_geometry

CODE = "d10h08e10f07_ball"
VARIANTS: dict[str, tuple[dict[str, Any], Settings]] = {
    "as it is": ({}, Settings()),
    "columns 1 mm": ({}, Settings(hx_mm=1.0)),
    "layers halved": ({"_WIDEST_LAYER_MM": 2.6, "_LEAST_GAP_MM": 1.0}, Settings()),
    "rows halved": ({"_SKIN_MM": 0.75, "_ROW_GROWTH": 1.8, "_ROW_MM": 4.0}, Settings()),
    "tighter tolerance": ({}, Settings(tolerance=1e-7)),
}
WHOLE = {"everything halved": ({}, Settings(refine=2))}


@contextmanager
def sizes(values: dict[str, Any]) -> Iterator[None]:
    """The grid's constants changed for a while."""
    usual = {name: getattr(grid, name) for name in values}
    forget_geometry()
    try:
        for name, value in values.items():
            setattr(grid, name, value)
        yield
    finally:
        for name, value in usual.items():
            setattr(grid, name, value)
        forget_geometry()


def main(whole: bool) -> None:
    names = ("base_kPa", "amp_kPa", "stdev_mm", "curvature", "D28_mm", "D0_mm")
    print("| mesh | nodes | " + " | ".join(names) + " | dip | CPU s |")
    print("|---" * (len(names) + 4) + "|", flush=True)
    first = None
    for words, (values, settings) in (VARIANTS | (WHOLE if whole else {})).items():
        with sizes(values):
            stroke = simulate(Case.from_code(CODE), settings)
        found = vars(stroke_features(over_the_lump(stroke)[0]))
        row = [found[name] for name in names]
        row.append(1 - found["D0_mm"] / found["D28_mm"])
        if first is None:
            first = row
            cells = [f"{value:.4f}" for value in row]
        else:
            cells = [f"{100 * (value / usual - 1):+.2f} %" for value, usual in zip(row, first)]
        print(f"| {words} | {stroke.nodes} | " + " | ".join(cells) + f" | {stroke.cpu_s:.1f} |", flush=True)


if __name__ == "__main__":
    main("whole" in sys.argv[1:])
