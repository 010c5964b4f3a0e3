"""How far rows by the border of the contact can be believed, docs/physics.md: python -m
tests.benchmarks.contact_border

Cells of columns of 2 and 1 mm against columns of 0.25 mm (1 over the ball) that are read up to the border:
read straight from node to node, and up to the border (`palpate.sim.tissue.border`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue import Case, Settings, simulate
from palpate.sim.tissue.solid.stroke import simulate_forces

PLANE = {
    "a lump 6 mm deep": "d08h08e20f05_G4_g15",
    "pressed into the fillets": "d12h04e05f09_G4_g15",
}
BALL = "d08h08e20f05_ball"
PLACES_MM = (-30.0, -27.7, -25.45, -23.2, -20.9, -18.65, -9.3, -6.1, -3.3, -1.2, 0.0)
"""At all phases of the nodes."""

Images = NDArray[np.float64]


def _plane(case: Case, settings: Settings) -> Images:
    return np.asarray(simulate(case, replace(settings, shells=3), positions_mm=PLACES_MM).images_kPa)


def _solid(case: Case, settings: Settings) -> Images:
    return simulate_forces(case, [case.F_rel], settings, PLACES_MM)[0].images_kPa


def main() -> None:
    print("| rms of the cells, Pa | 2 mm, straight | 2 mm | 1 mm, straight | 1 mm |")
    print("|---|--:|--:|--:|--:|", flush=True)
    for words, code in PLANE.items():
        _row(words, _plane, Case.from_code(code), 0.25, (2.0, 1.0))
    _row("a ball", _solid, Case.from_code(BALL), 1.0, (2.0,))


def _row(
    words: str, read: Callable[..., Images], case: Case, least: float, columns: tuple[float, ...]
) -> None:
    fine = read(case, Settings(hx_mm=least, to_border=True))
    off = [
        1000 * np.sqrt(np.square(read(case, Settings(hx_mm=hx, to_border=how)) - fine).mean())
        for hx in columns
        for how in (False, True)
    ]
    cells = [f"{pa:.0f}" for pa in off] + [""] * (4 - len(off))
    print(f"| {words} |", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
