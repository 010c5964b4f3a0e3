"""How the models that come with Palpate are made, and samples that show whether they are what they were."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from firmware_py.outputs import E_FAT
from palpate.files import json_text, whole_file
from palpate.learn import scopes
from palpate.learn.cylinders import fit_to_cylinders
from palpate.learn.data import prepare_strokes
from palpate.learn.emulator import fit_emulator
from palpate.learn.emulator_file import errors_of, write_emulator
from palpate.learn.lumps import SET, LumpStrokes, read_solid_rim, read_solids, solid_lumps
from palpate.learn.observed import observe_in_any_fat
from palpate.learn.plane_emulator import write_plane_emulator
from palpate.learn.plane_fit import errors_of as errors_of_plane
from palpate.learn.plane_fit import fit_plane_emulator
from palpate.learn.plane_frames import BLOCKS, plane_frames
from palpate.learn.result import TissueFit
from palpate.learn.solid import fit_to_balls
from palpate.model_export.integers import force_map as force_maps
from palpate.model_export.integers.reference import evaluate, inputs
from palpate.model_export.schema import ModelSpec
from palpate.models import (
    ANYWHERE,
    BALLS,
    FIELD,
    TOLD,
    emulator_path,
    file_hash,
    path,
    plane_emulator_path,
    recipe_path,
)  # fmt: skip
from palpate.progress import ProgressCallback
from palpate.sim.tissue import Case, simulate
from palpate.sim.tissue.any_tissue import FORCE_PARTS, PRESS_PARTS, PRESSES, STROKES, at_forces
from palpate.sim.tissue.solid.kept import read_kept
from palpate.sim.tissue.solid.kept import read_recipe as read_kept_recipe
from palpate.sim.tissue.solid.press import press_before
from palpate.sim.tissue.solid.stroke import simulate_forces as simulate_solid
from palpate.wire.events import OUTPUTS

MADE: dict[str, dict[str, Any]] = {
    FIELD: {"lumps": 1500, "noise": "typical", "seed": 1},
    BALLS: {"design": "some of balls:1000:1+balls-soft:96:1", "noise": "typical", "seed": 1},
    ANYWHERE: {"lumps": 1100, "noise": "typical", "seed": 1},
    TOLD: {"lumps": 1024, "noise": "typical", "seed": 1, "tissue": "thesis"},
}
"""Arguments of what prepares the strokes and fits, by model."""

SAMPLES: dict[str, Sequence[tuple[Case, float]]] = {
    FIELD: (
        (Case(12.0, 0.7, 20.0, 0.6, gland_ratio=6.0), 10.0),
        (Case(8.0, 0.6, 50.0, 0.5, gland_ratio=3.0, gland_mm=22.0, fat_stiffening=1.0), 18.0),
        (Case(17.0, 0.5, 5.0, 0.5, gland_ratio=8.0, gland_mm=12.0, gland_stiffening=2.0), 7.0),
        (Case(10.0, 0.8, 2.5, 0.45, gland_ratio=4.0, gland_mm=18.0, probe_radius_mm=41.0), 14.0),
    ),
    BALLS: ((Case.from_code("d12h06e20f07_ball"), 10.0), (Case.from_code("d16h04e05f05_ball_G4"), 15.0)),
    ANYWHERE: (
        (Case(11.0, 0.3, 20.0, 0.6, fat_mm=18.0, gland_ratio=6.0, gland_mm=20.0), 10.0),
        (Case(9.0, 0.6, 6.0, 0.5, fat_mm=10.0, gland_ratio=3.0, gland_mm=22.0, fat_stiffening=1.0), 18.0),
        (Case(15.0, 0.4, 50.0, 0.5, fat_mm=5.0, gland_ratio=5.0, gland_mm=28.0), 7.0),
    ),
    TOLD: tuple(
        (Case.from_code(code), 10.0)
        for code in ("d12h07e20f09", "d08h06e50f08", "d18h05e05f07", "d10h08e02f06")
    ),
}
"""Lumps that the models were not fitted to, on each side of their ranges' middle, and the fat's modulus."""

_SCOPES = {FIELD: scopes.BORDER, ANYWHERE: scopes.ANYWHERE, TOLD: scopes.TOLD}

SAMPLE_SEED = 7
EMULATOR, PLANE = "emulator", "plane"
"""Stand for a model's name where an emulator is to be made: of solid lumps, of cylinders."""
_KNOWN_OF = 25
"""Every so-manieth cylinder is not met by its emulator: that is what its errors are of."""


def build(name: str, directory: Path, progress: ProgressCallback | None = None) -> TissueFit:
    """Simulate into `directory` what it lacks, fit, and write model and recipe into this package.

    Parameters
    ----------
    name : str
        Of `palpate.models.NAMES`.
    directory : Path
        Strokes that are there already are used.
    progress : callable, optional
        See `palpate.progress.ProgressCallback`.
    """
    made = MADE[name]
    if name == BALLS:
        workers = os.cpu_count() or 1
        lumps, rim = read_solids(directory), read_solid_rim(directory)
        fit = fit_to_balls(lumps, made["noise"], made["seed"], workers=workers, progress=progress, rim=rim)
    else:
        scope = _SCOPES[name]
        strokes = prepare_strokes(directory, made["lumps"], progress=progress, scope=scope)
        fit = fit_to_cylinders(strokes, made["noise"], made["seed"], progress=progress, scope=scope)
    fit.spec.save(path(name))
    write_recipe(name, fit.spec, fit.to_dict())
    return fit


def build_emulator(sets: Sequence[Path]) -> None:
    """Fit the emulator of strokes over solid lumps; write it and its recipe into this package.

    Parameters
    ----------
    sets : sequence of Path
        Files of `palpate sweep --keep`, or directories that hold a balls.parquet.
    """
    files = [path / SET if path.is_dir() else path for path in sets]
    lumps = [lump for path in files for lump in solid_lumps(read_kept(path))]
    kept = [{"set": path.name, "sha256": read_kept_recipe(path)["sha256"]} for path in files]
    errors = errors_of(lumps)
    with whole_file(emulator_path()) as part:
        write_emulator(part, fit_emulator(lumps), errors)
    record = {
        "command": f"python -m palpate.models {EMULATOR} {' '.join(path.name for path in files)}",
        "sets": kept,
        "lumps": len(lumps),
        "errors_left": round(errors.left, 4),
        "sha256": file_hash(emulator_path()),
    }
    _write(emulator_path().with_suffix(".recipe.json"), record)


def build_plane_emulator(directory: Path, progress: ProgressCallback | None = None) -> dict[str, float]:
    """Compute into `directory` what it lacks, fit the emulator of cylinders, write it and its recipe.

    Returns
    -------
    dict
        What it gets wrong of cases that it has not met, in per cent.
    """
    frames, cases = plane_frames(directory, progress=progress)
    met = cases % _KNOWN_OF > 0
    emulator = fit_plane_emulator(frames.some(met), progress=progress)
    wrong = errors_of_plane(emulator, frames.some(~met), cases[~met])
    with whole_file(plane_emulator_path()) as part:
        write_plane_emulator(part, emulator)
    record = {
        "command": f"python -m palpate.models {PLANE} {directory}",
        "cases": [asdict(block) for block in BLOCKS],
        "computed": int(cases.max()) + 1,
        "frames": len(cases),
        "wrong": {words: round(error, 3) for words, error in wrong.items()},
        "sha256": file_hash(plane_emulator_path()),
    }
    _write(plane_emulator_path().with_suffix(".recipe.json"), record)
    return wrong


def write_recipe(name: str, spec: ModelSpec, scores: dict[str, Any]) -> None:
    """Write the recipe that belongs to the model file as it stands."""
    record = {
        "command": f"python -m palpate.models {name} out/{name}",
        "made": MADE[name],
        "sha256": file_hash(path(name)),
        "training": spec.training["hash"],
        "scores": {part: told for part, told in scores.items() if part != "training"},
        "sample": sample(name, spec),
    }
    _write(recipe_path(name), record)


def _write(target: Path, record: dict[str, Any]) -> None:
    with whole_file(target) as part:
        part.write_text(json_text(record) + "\n", encoding="utf-8")


def sample(name: str, spec: ModelSpec) -> list[dict[str, Any]]:
    """What the model says of its `SAMPLES`, simulated and observed anew.

    Returns
    -------
    list of dict
        code; `features` by name; for every output value, low, high and truth.
    """
    blob = b"" if spec.force_map is None else force_maps.blob(spec.force_map)
    found = []
    for k, (case, fat_kPa) in enumerate(SAMPLES[name]):
        lump = _solid(case) if case.solid else simulated(case)
        noise = MADE[name]["noise"]
        seen = observe_in_any_fat([lump], noise, SAMPLE_SEED + k, blob, fat_kPa=[fat_kPa])
        columns, true = inputs(spec, seen.X), seen.values[0]
        if spec.first is None:  # it was told the fat, and cannot know what the hand met on its way
            true[E_FAT] = fat_kPa
        said = evaluate(spec, columns)
        found.append(
            {
                "code": case.code,
                "fat_kPa": fat_kPa,
                "features": dict(zip(spec.features, np.round(columns[0], 6).tolist())),
                **{
                    output: {
                        **{part: round(float(said[part][0, j]), 6) for part in ("value", "low", "high")},
                        "truth": round(float(true[j]), 6),
                    }
                    for j, output in enumerate(OUTPUTS)
                },
            }
        )
    return found


def simulated(case: Case) -> LumpStrokes:
    """Strokes over a cylinder and the press before them."""
    strokes = tuple(simulate(c, STROKES) for c in at_forces([case], FORCE_PARTS))
    return LumpStrokes(strokes, tuple(simulate(c, PRESSES) for c in at_forces([case], PRESS_PARTS)))


def _solid(case: Case) -> LumpStrokes:
    strokes = simulate_solid(case, [case.F_rel * part for part in FORCE_PARTS], ramp=True)
    return LumpStrokes(tuple(strokes), press_before(strokes))
