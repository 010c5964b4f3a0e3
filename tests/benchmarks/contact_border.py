"""How far rows by the border of the contact can be believed, docs/physics.md: python -m
tests.benchmarks.contact_border

Cells of columns of 2 and 1 mm in the plane, read straight from node to node and up to the border
(`palpate.sim.tissue.border`), against columns of 0.25 mm that are read up to the border; and those over a
ball by columns of 3, 2 and 1.5 mm against 1 mm.
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
        row(
            words,
            _plane,
            Case.from_code(code),
            0.25,
            [Settings(hx_mm=hx, to_border=how) for hx in (2.0, 1.0) for how in (False, True)],
        )
    print("\n| rms of the cells, Pa | 3 mm | 2 mm | 1.5 mm |\n|---|--:|--:|--:|", flush=True)
    row("a ball", _solid, Case.from_code(BALL), 1.0, [Settings(hx_mm=hx) for hx in (3.0, 2.0, 1.5)])


def row(words: str, read: Callable[..., Images], case: Case, least_mm: float, asked: list[Settings]) -> None:
    fine = read(case, Settings(hx_mm=least_mm, to_border=True))
    off = [1000 * np.sqrt(np.square(read(case, settings) - fine).mean()) for settings in asked]
    print(f"| {words} |", " | ".join(f"{pa:.0f}" for pa in off), "|", flush=True)


if __name__ == "__main__":
    main()
