"""The foreign world: lumps, tissue, contact and sensor that no model was told of, to try real data on.

    python -m tests.foreign_world export DIRECTORY --lumps 24 --strokes 2    strokes as CSV, and their truth
    python -m tests.foreign_world keep                                       computes foreign_world.npz anew

Tissue that stiffens, friction of .2, a face 5 % too curved; a sensor with hysteresis and creep whose cells
read 4 % too much. The strokes that tests and docs/accuracy.md rest on are kept, with recipe and hash.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from palpate.sim.probe.cells import COLUMN_MM, FULL_SCALE_KPA, PEDESTAL_KPA, ROW_MM
from palpate.sim.probe.noise import LEVELS
from palpate.sim.probe.sensors import SensorModel, StrokeField
from palpate.sim.tissue import Case, Settings, Stroke, simulate_forces, sobol_cases
from palpate.sim.tissue.design import Ranges

FILE = Path(__file__).with_name("foreign_world.npz")
TISSUE = {"fat_stiffening": 3.0, "gland_stiffening": 3.0, "friction": 0.2, "probe_radius_mm": 38.0}
NOISE = replace(LEVELS["typical"], hysteresis=0.03, creep=0.02, dead=0.0)
COMMON_GAIN = 1.04
RANGES = Ranges((6.0, 18.0), (0.4, 1.3), (2.0, 1000.0), (0.4, 0.9))
LUMPS, SEED = 160, 41
STEP = 1.4**0.5
SETTINGS = Settings(far_start_mm=-44.0)
RECIPE = {"tissue": TISSUE, "lumps": LUMPS, "seed": SEED, "step": STEP, "far_start_mm": -44.0}
FRAMES = 50


def cases(n: int = LUMPS, seed: int = SEED) -> list[Case]:
    """Lumps of the foreign world, each at its middle force."""
    return [replace(case, **TISSUE) for case in sobol_cases(n, seed, RANGES)]


def pair(case: Case) -> list[Stroke]:
    """A lump's strokes at two forces around its own."""
    forces = [case.F_rel / STEP, case.F_rel * STEP]
    return simulate_forces(replace(case, F_rel=forces[0]), forces, SETTINGS)


def keep(path: Path = FILE) -> None:
    """Compute all strokes and keep what the sensors need of them, to the pascal and the micrometre."""
    wanted = cases()
    with ProcessPoolExecutor(2) as pool:
        found = list(pool.map(pair, wanted, chunksize=4))
    images = np.array([[s.images_kPa for s in strokes] for strokes in found])
    depths = np.array([[s.displacement_mm for s in strokes] for strokes in found])
    arrays = {
        "images_Pa": np.rint(1e3 * np.maximum(images, 0)).astype(np.uint16),
        "depths_um": np.rint(1e3 * depths).astype(np.uint16),
        "positions_mm": found[0][0].positions_mm,
        "cases": np.array([[c.d_mm, c.h, c.E_ratio, c.F_rel] for c in wanted]),
    }
    np.savez_compressed(path, recipe=json.dumps(RECIPE | {"sha256": digest(arrays)}), **arrays)


def digest(arrays: dict[str, np.ndarray]) -> str:
    """SHA-256 of the numbers that are kept."""
    hashed = hashlib.sha256()
    for name in sorted(arrays):
        hashed.update(np.ascontiguousarray(arrays[name]).tobytes())
    return hashed.hexdigest()


def kept(path: Path = FILE) -> list[StrokeField]:
    """The lumps that were kept, as the sensor model wants them."""
    table = np.load(path)
    out = []
    for numbers, images, depths in zip(table["cases"], table["images_Pa"], table["depths_um"]):
        d, h, E, F = map(float, numbers)
        pairs = zip((F / STEP, F * STEP), images, depths)
        out.append(
            StrokeField(
                *(_stroke(Case(d, h, E, f, **TISSUE), table["positions_mm"], i, u) for f, i, u in pairs)
            )
        )
    return out


def _stroke(case: Case, positions: np.ndarray, images: np.ndarray, depths: np.ndarray) -> Stroke:
    values = dict.fromkeys((f.name for f in fields(Stroke)), 0) | {
        "case": case, "positions_mm": positions, "images_kPa": images / 1e3, "displacement_mm": depths / 1e3
    }  # fmt: skip
    return Stroke(**values)


class Laboratory:
    """One sensor in the hands of one person: its cells stay what they are from stroke to stroke.

    Parameters
    ----------
    seed : int
        Same seed, same sensor.
    """

    def __init__(self, seed: int = 1) -> None:
        self.seed = seed
        self._cells: SensorModel | None = None

    def over(self, field: StrokeField, stroke: int) -> SensorModel:
        """The sensor over a lump, for the stroke of this number; zeros are taken anew for each."""
        model = SensorModel(field, NOISE, 1000 * self.seed + stroke)
        if self._cells is None:
            self._cells = SensorModel(field, NOISE, self.seed)
            self._cells.gain *= COMMON_GAIN / self._cells.gain.mean()
        model.gain = self._cells.gain
        return model


def export(directory: Path, fields_: list[StrokeField], strokes: int, seed: int = 1) -> None:
    """Strokes as CSV, a file a lump, and the truth as truth.csv; the array is the one in use."""
    import pandas as pd

    directory.mkdir(parents=True, exist_ok=True)
    laboratory, truths = Laboratory(seed), []
    names = [f"p_{r}_{c}" for r in range(len(ROW_MM)) for c in range(len(COLUMN_MM))]
    for k, field in enumerate(fields_):
        parts = []
        for number in range(strokes):
            seen = laboratory.over(field, 100 * k + number).stroke(FRAMES)
            kPa = np.rint(1e3 * (seen.counts / 4095 * FULL_SCALE_KPA - PEDESTAL_KPA)) / 1e3
            part = pd.DataFrame(kPa, columns=names)
            part.insert(0, "stroke", number + 1)
            part.insert(1, "t_s", seen.times_us / 1e6)
            part.insert(2, "x_mm", seen.positions_um / 1e3)
            part.insert(3, "z_mm", seen.displacements_um / 1e3)
            parts.append(part)
            case = field.low.case
            truths.append({
                "recording": f"lump-{k + 1:02}.mcap", "stroke": number + 1, "lump": f"L{k + 1:02}",
                "d_mm": round(case.d_mm, 3), "depth_mm": round(case.depth_mm, 3),
                "E_ratio": round(case.E_ratio, 3), "place": "border", "tissue": "foreign",
                "visit": f"day {1 + number * 2 // strokes}", "who": "A", "when": "2026-11-21",
            })  # fmt: skip
        pd.concat(parts).to_csv(directory / f"lump-{k + 1:02}.csv", index=False)
    pd.DataFrame(truths).to_csv(directory / "truth.csv", index=False)


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["export", "keep"])
    parser.add_argument("directory", nargs="?", type=Path)
    parser.add_argument("--lumps", type=int, default=24)
    parser.add_argument("--strokes", type=int, default=2)
    said = parser.parse_args(arguments)
    if said.what == "keep":
        keep()
    else:
        export(said.directory, kept()[: said.lumps], said.strokes)


if __name__ == "__main__":
    main(sys.argv[1:])
