"""The foreign world: lumps, tissue, contact and sensor that no model was told of, to try real data on.

    python foreign_world.py export DIRECTORY --lumps 24 --strokes 2    strokes as CSV, and their truth
    python foreign_world.py campaign DIRECTORY                         the sensor in air, under a cuff
    python foreign_world.py keep                                       computes foreign_world.npz anew

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
import pandas as pd

from palpate.sim.probe.noise import LEVELS
from palpate.sim.probe.sensors import SensorModel, StrokeField
from palpate.sim.tissue import Case, Settings, Stroke, simulate_forces, sobol_cases
from palpate.sim.tissue.design import Ranges
from palpate.wire.cells import COLUMN_MM, FULL_SCALE_KPA, PEDESTAL_KPA, ROW_MM

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
    """Strokes as CSV, a file for each lump and day, and truth.csv; the array is the one in use."""
    laboratory, truths = Laboratory(seed), []
    for k, field in enumerate(fields_):
        for day in (1, 2):
            name = f"lump-{k + 1:02}-day-{day}"
            seen = [laboratory.over(field, 100 * k + 10 * day + n).stroke(FRAMES) for n in range(strokes)]
            write(
                directory / f"{name}.csv",
                [(s.counts, s.positions_um, s.displacements_um, s.times_us) for s in seen],
            )
            case = field.low.case
            truths += [
                {
                    "recording": f"{name}.mcap", "stroke": n + 1,
                    "lump": f"L{k + 1:02}", "visit": f"day {day}",
                    "d_mm": round(case.d_mm, 3), "depth_mm": round(case.depth_mm, 3), "place": "border",
                    "E_ratio": round(case.E_ratio, 3), "tissue": "foreign", "who": "A", "when": "2026-11-21",
                }
                for n in range(strokes)
            ]  # fmt: skip
    pd.DataFrame(truths).to_csv(directory / "truth.csv", index=False)


def write(path: Path, parts: list[tuple[np.ndarray, ...]]) -> None:
    """Frames as CSV: kPa of each cell, time in s, place and displacement in mm, number of the stroke."""
    path.parent.mkdir(parents=True, exist_ok=True)
    names = [f"p_{r}_{c}" for r in range(len(ROW_MM)) for c in range(len(COLUMN_MM))]
    tables = []
    for number, (counts, x_um, z_um, time_us) in enumerate(parts):
        count = np.clip(np.rint(counts), 0, 4095)
        kPa = np.round(count / 4095 * FULL_SCALE_KPA - PEDESTAL_KPA, 4)
        table = pd.DataFrame(kPa.reshape(len(kPa), -1), columns=names)
        for at, (name, values) in enumerate(
            {"t_s": time_us / 1e6, "x_mm": x_um / 1e3, "z_mm": z_um / 1e3}.items()
        ):
            table.insert(at, name, values)
        table.insert(0, "stroke", number + 1)
        tables.append(table)
    pd.concat(tables).to_csv(path, index=False)


CUFF = [[0, 0], [0.5, 0], [0.5, 18], [2, 18], [4, 0], [5, 0], [6, 12], [8, 0]]


def campaign(directory: Path, field: StrokeField, seed: int = 1) -> None:
    """The sensor in air and under a cuff, as CSV, and campaign.toml, which says what they are of."""
    laboratory, said = Laboratory(seed), []
    times, levels = np.array(CUFF, float).T
    for kind, count, seconds in (("air", 8, 2.0), ("cuff", 4, 8.0)):
        time = np.arange(0, seconds, 0.02)
        kPa = np.interp(time, times + 1e-6 * np.arange(len(times)), levels) if kind == "cuff" else 0 * time
        for k in range(count):
            sensor = laboratory.over(field, 5000 + 100 * count + k)
            p = np.broadcast_to(kPa[:, None, None], (len(time), len(ROW_MM), len(COLUMN_MM)))
            felt = sensor.felt(p, 0 * time, 60 * time, np.linspace(0, 1, len(time)))
            write(directory / f"{kind}-{k + 1}.csv", [(felt[0], 0 * felt[1], felt[2], 1e6 * time)])
            more = f"kPa = {CUFF}" if kind == "cuff" else "displacement_mm = 0.0"
            said.append(f'[[recording]]\nfile = "{kind}-{k + 1}.mcap"\nkind = "{kind}"\n{more}\n')
    (directory / "campaign.toml").write_text("\n".join(said))


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["export", "campaign", "keep"])
    parser.add_argument("directory", nargs="?", type=Path, default=Path("out/foreign"))
    parser.add_argument("--lumps", type=int, default=24, help="how many to export")
    parser.add_argument("--strokes", type=int, default=2, help="over each, on each of two days")
    said = parser.parse_args(arguments)
    if said.what == "keep":
        keep()
    elif said.what == "campaign":
        campaign(said.directory, kept()[0])
    else:
        export(said.directory, kept()[: said.lumps], said.strokes)


if __name__ == "__main__":
    main(sys.argv[1:])
