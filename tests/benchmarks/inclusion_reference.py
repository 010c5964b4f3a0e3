"""A published case of contact over an inclusion: python -m tests.benchmarks.inclusion_reference [FILE.csv]

Writes docs/evidence/inclusion-contact.csv, which docs/evidence/inclusion-contact.md explains: ours on three
meshes, each with every element half the size of the one before, what they tend to with an error bar, and
felupe and CalculiX on the first of them. Minutes.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.console import note
from palpate.files import whole_file
from palpate.sim.tissue import SENSORS_MM, Case, Settings, simulate
from tests.benchmarks.peers import calculix_stroke, felupe_stroke

FILE = Path("docs/evidence/inclusion-contact.csv")
CODE = "d10h08e10f10"
HEADS = (
    "quantity", "position_mm", "place_mm", "coarse", "halved", "quartered", "estimate", "error", "felupe",
    "calculix",
)  # fmt: skip


def estimate(halved: NDArray, quartered: NDArray) -> tuple[NDArray, NDArray]:
    """What meshes tend to, and how far that may be off.

    A bump converges with first order, so the finest mesh is taken as far again as it is from the one before.
    That step is the error bar.
    """
    return 2 * quartered - halved, np.abs(quartered - halved)


def rows() -> list[list[str]]:
    """The table, of displacements (mm) first, then of sensors' pressures (kPa)."""
    case, settings = Case.from_code(CODE), Settings()
    own = []
    for factor in (1, 2, 4):
        own.append(simulate(case, settings.refined(factor)))
        note(f"every element divided by {factor}: {own[-1].nodes:,} nodes, {own[-1].cpu_s:.1f} CPU s")
    others = []
    for peer in (felupe_stroke, calculix_stroke):
        others.append(peer.run(case, settings))
        note(f"{others[-1].name}: {others[-1].iterations} solutions, {others[-1].cpu_s:.1f} CPU s")
    programs = [*own, *others]
    places = own[0].positions_mm
    displacements = np.array([p.displacement_mm for p in programs])
    images = np.array([p.images_kPa for p in programs])
    found = [["displacement_mm", f"{x:g}", "", *_cells(displacements[:, i])] for i, x in enumerate(places)]
    for i, x in enumerate(places):
        for j, s in enumerate(SENSORS_MM):
            found.append(["pressure_kPa", f"{x:g}", f"{s:g}", *_cells(images[:, i, j])])
    _tell(displacements, images)
    return found


def _cells(of: NDArray) -> list[str]:
    value, error = estimate(of[1], of[2])
    return [f"{v:.5f}" for v in (*of[:3], value, error, *of[3:])]


def _tell(displacements: NDArray, images: NDArray) -> None:
    """How far each program is from the estimate: displacement at most, pressure by rms over the sensors, and
    the range of what the image over the lump has more than the first."""
    depth, image = estimate(displacements[1], displacements[2])[0], estimate(images[1], images[2])[0]
    peak = image.max(1)
    for name, d, p in zip(HEADS[3:6] + HEADS[8:], displacements, images):
        rms = np.sqrt(((p - image) ** 2).mean(1)) / peak
        bump = np.ptp(p[-1] - p[0]) / np.ptp(image[-1] - image[0]) - 1
        note(
            f"{name}: displacement within {100 * np.abs(d / depth - 1).max():.2f} %, pressure "
            f"{100 * rms.max():.2f} % of the peak, bump {100 * bump:+.1f} %"
        )


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else FILE
    table = rows()
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as out:
        csv.writer(out, lineterminator="\n").writerows([HEADS, *table])
    note(f"wrote {path}")


if __name__ == "__main__":
    main()
