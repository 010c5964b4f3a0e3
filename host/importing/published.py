"""Two layouts that others have published, as named arrays of which a declaration speaks.

| layout | arrays |
|---|---|
| presses (`presses.read_mat`) | taxels, depth_mm, press (its number), still_mm (no movement) |
| LESS (`less.read_less`) | normal, shear_x, shear_y, time_s, along_mm, depth_mm, trajectory (its number) |

Neither says what a reading is in kPa: the declaration must (`unit = "counts"`, `kPa_per_unit`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.importing.less import read_less
from palpate.importing.presses import read_mat

Named = dict[str, NDArray[np.float64]]
OF_PRESSES = "[pressure] taxels, [displacement] depth_mm, [position] still_mm, [stroke] press"
OF_LESS = (
    "[pressure] normal, [displacement] depth_mm, [position] along_mm, [time] time_s, [stroke] trajectory"
)


def presses(path: Path) -> Named:
    """Every whole press of a file, one after the other; raises as `read_mat`."""
    found = read_mat(path)
    whole = [(k, n) for k in range(len(found.places)) for n in range(found.rise.shape[3])
             if (found.places[k], n + 1) not in found.broken]  # fmt: skip
    depths = len(found.depth_mm)
    return {
        "taxels": np.concatenate([found.rise[k, :, :, n] for k, n in whole]),
        "depth_mm": np.tile(found.depth_mm, len(whole)),
        "press": np.repeat(np.arange(1.0, len(whole) + 1), depths),
        "still_mm": np.zeros(depths * len(whole)),
    }


def trajectories(path: Path) -> Named:
    """Every trajectory of a file, one after the other; raises as `read_less`.

    `along_mm` is the way along the line that the hand's places are nearest to, `depth_mm` how far under its
    first place the hand was; the robot's places are in m, its z points up.
    """
    found = read_less(path)
    parts: dict[str, list[NDArray[np.float64]]] = {}
    for number, each in enumerate(found, 1):
        flat = 1000 * (each.position[:, :2] - each.position[0, :2])
        axis = np.linalg.svd(flat - flat.mean(0), full_matrices=False)[2][0]
        along = flat @ axis
        for name, values in {
            "normal": each.felt[:, :, 2],
            "shear_x": each.felt[:, :, 0],
            "shear_y": each.felt[:, :, 1],
            "time_s": each.time - each.time[0],
            "along_mm": along * (np.sign(along[-1]) or 1.0),
            "depth_mm": 1000 * (each.position[0, 2] - each.position[:, 2]),
            "trajectory": np.full(len(each.time), float(number)),
        }.items():
            parts.setdefault(name, []).append(values)
    return {name: np.concatenate(values) for name, values in parts.items()}
