"""Presses into phantoms that others have published, without a scale in pascals.

The layout is of "Structuring of tactile sensory information for category formation in robotics palpation"
(Scimeca, Maiolino, Iida 2020; github.com/lucascimeca/palpation_analysis): a .mat file whose
`Vertical_ROW_COLUMN` holds depths x (1 + taxels) x repeats, the first column the depth in mm, and whose
`nodules` holds the kind of each place, 5 where there is none. Readings are raw numbers of a capacitive skin.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import UsageError
from palpate.files import read_whole

Floats = NDArray[np.float64]
NONE = 5
KINDS = {4: "big, shallow", 2: "big, deep", 3: "small, shallow", 1: "small, deep", NONE: "none"}
"""Source: `class_names` of its src/experiment_setup.py."""
_NAME = re.compile(r"Vertical_(\d+)_(\d+)")
_MOST_BYTES = 1 << 28
_WHOLE = 0.5
"""Of the median rise at the greatest depth: a repeat with less began on the phantom, or did not press."""


@dataclass(frozen=True)
class Presses:
    """Presses at some places.

    Parameters
    ----------
    places : tuple of (int, int)
    kinds : tuple of int
        See `KINDS`.
    depth_mm : (depths,)
    rise : (places, depths, taxels, repeats)
        Readings less the first of their repeat; NaN throughout a repeat that is not whole.
    """

    places: tuple[tuple[int, int], ...]
    kinds: tuple[int, ...]
    depth_mm: Floats
    rise: Floats

    @property
    def broken(self) -> list[tuple[tuple[int, int], int]]:
        """Place and number (from 1) of each repeat that is not whole."""
        lost = np.isnan(self.rise[:, -1, 0])
        return [(self.places[k], int(n) + 1) for k, n in zip(*np.nonzero(lost))]


def read_mat(path: Path) -> Presses:
    """Read a file of this layout.

    Raises
    ------
    NoSuchFile, UsageError
        It is not there, or something else.
    """
    import io

    from scipy.io import loadmat

    raw = read_whole(path, "file of presses", _MOST_BYTES)
    try:
        stream: Any = io.BytesIO(raw)
        told = loadmat(stream)
        found = {m: np.asarray(told[name], float) for name in told if (m := _NAME.fullmatch(name))}
        places = sorted((int(m[1]), int(m[2])) for m in found)
        cells = {(int(m[1]), int(m[2])): array for m, array in found.items()}
        stack = np.stack([cells[place] for place in places])
        kinds = tuple(int(told["nodules"][i - 1, j - 1, 0]) for i, j in places)
        depth_mm = stack[0, :, 0, 0]
        sound = stack.ndim == 4 and stack.shape[2] > 2 and bool((np.diff(depth_mm) > 0).all())
        sound &= bool((stack[:, :, 0] == depth_mm[:, None]).all()) and set(kinds) <= set(KINDS)
    except Exception as error:  # of a hostile file scipy raises whatever it likes
        raise UsageError(f"{path} does not hold presses: {type(error).__name__} while it was read") from None
    if not sound:
        raise UsageError(
            f"{path} does not hold presses: depths x (1 + taxels) x repeats a place, and `nodules`"
        )
    rise = stack[:, :, 1:] - stack[:, :1, 1:]
    end = rise[:, -1].mean(axis=1)
    whole = end > _WHOLE * np.median(end)
    rise = np.where(whole[:, None, None, :], rise, np.nan)
    return Presses(tuple(places), kinds, depth_mm, rise)
