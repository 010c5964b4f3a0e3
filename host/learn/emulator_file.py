"""An emulator of strokes over solid lumps as one compact file, with what it gets wrong.

Processes of one set of rows share its inputs. Weights are float64: they are large and cancel.
What it gets wrong is known from lumps that a second emulator has not met, and is kept as principal
components: of a stroke at its middle force, position by position, and of the ramp before it, over the force.
Units: mm; kPa over (force over the fat's modulus, mm).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate.features.map_features import Floats
from palpate.learn.emulator import Parts, StrokeEmulator, fit_emulator, inputs_of
from palpate.learn.gaussian_process import GaussianProcess
from palpate.learn.lumps import LumpStrokes

_COARSE = ("_parts", "_mean", "_image")
"""What float32 is good enough for."""

KNOWN_OF = 4
"""Every so-manieth lump is not met by the emulator whose errors are looked at."""
COMPONENTS = 12
_MIDDLE = 1


@dataclass(frozen=True)
class Errors:
    """What an emulator gets wrong: principal components of images and displacement, each of one spread.

    Attributes
    ----------
    image : ndarray (components, positions + ramp, cells)
        Of the stroke, then of the ramp's forces at the first position; in fat of 1 kPa over force.
    depth : ndarray (components, positions + ramp)
        Of the displacement, over itself.
    left : float
        The share of variance that they leave.
    """

    image: Floats
    depth: Floats
    left: float


def errors_of(lumps: Sequence[LumpStrokes]) -> Errors:
    """What emulators get wrong of lumps that they have not met."""
    asked = lumps[KNOWN_OF - 1 :: KNOWN_OF]
    known = [lump for k, lump in enumerate(lumps) if (k + 1) % KNOWN_OF]
    emulator = fit_emulator(known)
    rows = np.array([_wrong(emulator, lump) for lump in asked])
    _, size, parts = np.linalg.svd(rows, full_matrices=False)
    of = (size[:COMPONENTS, None] * parts[:COMPONENTS] / np.sqrt(len(rows))).reshape(
        COMPONENTS, -1, int(np.prod(emulator.shape)) + 1
    )
    left = 1 - float((size[:COMPONENTS] ** 2).sum() / (size**2).sum())
    return Errors(of[:, :, :-1], of[:, :, -1] / _DEPTH_WEIGHT, left)


_DEPTH_WEIGHT = 3.0
"""A share of the displacement counts so many times one of a cell's pressure over the force."""


def _wrong(emulator: StrokeEmulator, lump: LumpStrokes) -> Floats:
    """Computed less emulated, one row."""
    stroke = lump.strokes[_MIDDLE]
    ramp = lump.press[: len(lump.press) - len(lump.strokes)]
    x = np.array([inputs_of(stroke.case)])
    images, depths = (one[0] for one in emulator.stroked(x, *emulator.pressed(x)))
    low = np.array([inputs_of(one.case) for one in ramp])
    low_images, low_depths = emulator.pressed(low)
    force = np.exp(np.append(np.full(len(images), x[0, -1]), low[:, -1]))
    computed = np.concatenate([stroke.images_kPa, *(one.images_kPa for one in ramp)])
    image = (computed - np.concatenate([images, low_images])).reshape(len(force), -1)
    image /= force[:, None] * stroke.case.fat_kPa
    deep = np.concatenate([stroke.displacement_mm, *(one.displacement_mm for one in ramp)])
    depth = deep / np.concatenate([depths, low_depths]) - 1
    return np.column_stack([image, _DEPTH_WEIGHT * depth]).ravel()


def write_emulator(path: Path, emulator: StrokeEmulator, errors: Errors) -> None:
    """Write both."""
    arrays: dict[str, Any] = {"positions_mm": emulator.positions_mm, "shape": np.array(emulator.shape)}
    for name, processes in _groups(emulator).items():
        first = processes[0]
        arrays |= {f"{name}_{key}": getattr(first, key) for key in ("centre", "scale", "z")}
        arrays |= {
            f"{name}_{key}": np.array([getattr(one, key) for one in processes])
            for key in ("line", "unit", "theta", "weights")
        }
    for name in ("press", "bump", "dip"):
        arrays |= {
            f"{name}_mean": getattr(emulator, name).mean,
            f"{name}_parts": getattr(emulator, name).parts,
        }
    arrays |= {"error_image": errors.image, "error_depth": errors.depth, "error_left": np.array(errors.left)}
    small = {k: v.astype(np.float32) if k.endswith(_COARSE) else v for k, v in arrays.items()}
    with path.open("wb") as out:
        np.savez_compressed(out, **small)


def read_emulator(path: Path) -> tuple[StrokeEmulator, Errors]:
    """What `write_emulator` has written."""
    with np.load(path) as file:
        found = {name: np.asarray(file[name], float) for name in file.files}
    processes = {name: _processes(found, name) for name in ("pressed", "signed", "unsigned")}
    bumps = len(found["bump_parts"])
    (ln_depth, ln_mean, *press), signed = processes["pressed"], processes["signed"]
    ln_bump, ln_dip = processes["unsigned"]
    emulator = StrokeEmulator(
        found["positions_mm"], tuple(int(n) for n in found["shape"]), ln_depth, ln_mean,
        _parts(found, "press", press), ln_bump, _parts(found, "bump", signed[:bumps]),
        ln_dip, _parts(found, "dip", signed[bumps:]),
    )  # fmt: skip
    return emulator, Errors(found["error_image"], found["error_depth"], float(found["error_left"]))


def _groups(of: StrokeEmulator) -> dict[str, tuple[GaussianProcess, ...]]:
    """Processes that were fitted to the same rows."""
    return {
        "pressed": (of.ln_depth, of.ln_mean, *of.press.processes),
        "signed": (*of.bump.processes, *of.dip.processes),
        "unsigned": (of.ln_bump, of.ln_dip),
    }


def _processes(found: dict[str, Any], name: str) -> list[GaussianProcess]:
    centre, scale, z = (found[f"{name}_{key}"] for key in ("centre", "scale", "z"))
    each = zip(*(found[f"{name}_{key}"] for key in ("line", "unit", "theta", "weights")), strict=True)
    return [GaussianProcess(centre, scale, line, float(unit), theta, z, w) for line, unit, theta, w in each]


def _parts(found: dict[str, Any], name: str, processes: Sequence[GaussianProcess]) -> Parts:
    return Parts(found[f"{name}_mean"], found[f"{name}_parts"], tuple(processes))
