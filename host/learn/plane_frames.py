"""The frames that the emulator in the plane learns from: computed, with their derivatives by every input.

Cases fill the emulator's range (a scrambled Sobol sequence), thin skin once more: there images are sharpest.
One that cannot be computed is left out. What is done is kept, so a run that was ended goes on.
Units: mm, kPa, N/m, in fat of 10 kPa.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from palpate.files import whole_file
from palpate.learn.plane_emulator import B_OF_THE_FAT, HIGH, LOW, MESH, PLACE, ROWS, inputs_of
from palpate.learn.plane_fit import Frames
from palpate.progress import ProgressCallback, Steps
from palpate.sim.tissue import Case, CaseError, StrokeError
from palpate.sim.tissue.derivatives import differentiate
from palpate.sim.tissue.frames import solve_frames
from palpate.sim.tissue.topology import Topology
from palpate.sim.tissue.workers import pool
from palpate.wire.cells import PITCH_MM

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FIELDS = (
    "d_mm", "h", "fat_mm", "E_ratio", "gland_ratio", "gland_mm", "fat_stiffening", "gland_stiffening",
    "probe_radius_mm",
)  # fmt: skip
_FAT_KPA = 10.0
_REACH_MM = -40.0, 4.0
_FACE_MM = ROWS * PITCH_MM
_LOG2_DRAWN = 14
_LN_F = np.log([1.8, 16.0])
"""The stroke's; a press before it comes from less."""
_THIN_MM = 6.0
_DEEPEST, _CORNER = 0.93, 6
"""A gland ends so far below a lump in it, its corner so sharp, as in the inversion."""
_NARROW, _FAR_DOWN_MM, _STIFF = 3.5, 38.0, 4.5
"""Nobody feels a lump that is deeper than so many of its diameters, or reaches so far down below thin skin;
where both layers stiffen so much there is no equilibrium."""
_PIECE = 64


@dataclass(frozen=True)
class Block:
    """Cases of one sequence, first to end; all under thin skin, or anywhere."""

    seed: int
    first: int
    end: int
    thin: bool = False


BLOCKS = Block(17, 0, 1439), Block(17, 9000, 9519), Block(18, 0, 656, thin=True)
"""Those of the bundled emulator."""


def plane_frames(
    directory: Path, blocks: Sequence[Block] = BLOCKS, progress: ProgressCallback | None = None
) -> tuple[Frames, Ints]:
    """Compute into `directory` what it lacks; all frames, and which of all cases each is of, ascending."""
    pieces = [
        Block(block.seed, k, min(k + _PIECE, block.end), block.thin)
        for block in blocks
        for k in range(block.first, block.end, _PIECE)
    ]
    paths = [directory / f"frames-{one.seed}-{one.first}-{one.end}.npz" for one in pieces]
    directory.mkdir(parents=True, exist_ok=True)
    missing = [(piece, path) for piece, path in zip(pieces, paths) if not path.exists()]
    steps = Steps("Frames for the emulator", len(missing), progress)
    if missing:
        with pool(os.cpu_count() or 1, __name__) as workers:
            for path in _computed(workers, missing):
                steps(path.name)
    each: list[Frames] = []
    cases: list[Ints] = []
    for path in paths:
        with np.load(path) as file:
            each.append(Frames(file["x"], file["y"], file["slopes"]))
            cases.append(file["case"] + (cases[-1].max() + 1 if cases else 0))
    whole = Frames(*(np.concatenate([getattr(one, name) for one in each]) for name in ("x", "y", "slopes")))
    return whole, np.concatenate(cases)


def _computed(workers: Executor, missing: Sequence[tuple[Block, Path]]) -> Iterator[Path]:
    for done in as_completed([workers.submit(_keep, *one) for one in missing]):
        yield done.result()


def _keep(piece: Block, path: Path) -> Path:
    drawn = _drawn(piece)
    found = [(k, one) for k in range(piece.first, piece.end) if (one := _frames_of(drawn[k], piece, k))]
    x, y, slopes = (np.concatenate([getattr(one, name) for _, one in found]) for name in ("x", "y", "slopes"))
    case = np.concatenate([np.full(len(one.x), k - piece.first) for k, one in found])
    with whole_file(path) as part, part.open("wb") as out:
        np.savez_compressed(out, x=x, y=y, slopes=slopes, case=case)
    return path


def _drawn(block: Block) -> Floats:
    """All cases of a sequence: the emulator's first nine inputs, b as b, and ln F of the stroke, (n, 10)."""
    low, high = np.append(LOW[:PLACE], _LN_F[0]), np.append(HIGH[:PLACE], _LN_F[1])
    stiffening = slice(B_OF_THE_FAT, B_OF_THE_FAT + 2)
    high[stiffening] = 2.25
    if block.thin:
        high[1] = np.log(_THIN_MM)
    x = low + qmc.Sobol(len(low), seed=block.seed).random_base2(_LOG2_DRAWN) * (high - low)
    x[:, stiffening] **= 2  # most tissue stiffens little
    return x


def _frames_of(drawn: Floats, block: Block, k: int) -> Frames | None:
    """One case's frames; none where nobody would feel it, or where it cannot be computed."""
    d, depth, t, gland = np.exp(drawn[[0, 1, 2, 5]])
    far_down = block.thin and depth + d > _FAR_DOWN_MM
    if depth / d > _NARROW or far_down or (drawn[B_OF_THE_FAT : B_OF_THE_FAT + 2] > _STIFF).all():
        return None
    least = max((depth + d - t) / _DEEPEST, 0.0)
    gland = (gland**_CORNER + least**_CORNER) ** (1 / _CORNER)
    places, ln_F = _places(float(drawn[9]), np.random.default_rng([block.seed, k]))
    try:
        case = Case(
            float(d), float(depth / d), float(drawn[3] ** -1.5), 0.5, fat_mm=float(t), fat_kPa=_FAT_KPA,
            gland_ratio=float(np.exp(drawn[4])), gland_mm=float(gland), fat_stiffening=float(drawn[6]),
            gland_stiffening=float(drawn[7]), probe_radius_mm=float(np.exp(drawn[8])),
        )  # fmt: skip
        topology = Topology(case, MESH, *_REACH_MM)
        solved = solve_frames(case, MESH, topology.geometry(case), places, _FAT_KPA * np.exp(ln_F))
        by = differentiate(solved, topology, _FIELDS)
    except (CaseError, StrokeError):
        return None
    F, depths = solved.forces_N_per_m, solved.displacement_mm
    mean_kPa = F / _FACE_MM
    y = np.column_stack([solved.images_kPa / mean_kPa[:, None], np.log(depths)])
    slopes = np.concatenate(
        [by.images / mean_kPa[:, None, None], (by.displacement / depths[:, None])[:, None]], 1
    )
    slopes[..., -1] *= F[:, None]  # by ln F
    slopes[:, :ROWS, -1] -= y[:, :ROWS]
    slopes[..., :PLACE] = slopes[..., :PLACE] @ _of_inputs(case)
    if not np.isfinite(slopes).all():
        return None
    x = np.column_stack([np.tile(inputs_of(case), (len(F), 1)), places, ln_F])
    return Frames(x.astype(np.float32), y.astype(np.float32), slopes.astype(np.float16))


def _places(ln_F: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Where the frames stand, and ln F: a press, a stroke of changing force, sometimes one far away."""
    first = -int(rng.integers(25, 35))
    there = np.arange(first, 3, 3)
    there = there + np.concatenate([[0], rng.integers(-1, 2, len(there) - 1)])
    before, after = rng.uniform(-0.15, 0.15, 2).tolist()
    stroked = ln_F + np.linspace(before, after, len(there))
    pressed = stroked[0] + np.log(np.array([0.08, 0.22, 0.5]) * np.exp(0.25 * rng.standard_normal(3)))
    places = np.concatenate([np.full(3, first), there]).astype(float)
    forces = np.concatenate([pressed, stroked])
    if rng.random() < 0.3:
        places, forces = np.append(-float(rng.integers(36, 41)), places), np.append(ln_F, forces)
    return places, forces


def _of_inputs(case: Case) -> Floats:
    """Derivatives of `_FIELDS` by the emulator's first nine inputs, (9, 9)."""
    by = np.eye(len(_FIELDS))
    own = {
        "d_mm": case.d_mm, "h": case.h, "fat_mm": case.fat_mm, "E_ratio": -1.5 * case.E_ratio ** (5 / 3),
        "gland_ratio": case.gland_ratio, "gland_mm": case.gland_mm, "probe_radius_mm": case.probe_radius_mm,
    }  # fmt: skip
    for name, size in own.items():
        by[_FIELDS.index(name)] *= size
    by[1, 0] = -case.h
    return by
