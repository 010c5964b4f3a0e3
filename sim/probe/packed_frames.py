"""Frames as the wire carries them, and the truth behind them. Positions in um, times in us."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py.outputs import NAMES
from palpate.sim.tissue.case import Case

FORCE, FAT = "F_N_per_m", "E_fat_kPa"


@dataclass(frozen=True)
class Truth:
    """What the estimate is compared with: the case, and the mean force that the hand really kept.

    Attributes
    ----------
    case : Case
    F_N_per_m : float
    centre_mm : float
        Where the lump is in the stroke.
    stiffness : float
        Of the tissue, over the case's (`Noise.modulus`).
    """

    case: Case
    F_N_per_m: float
    centre_mm: float
    stiffness: float = 1.0

    @property
    def fat_kPa(self) -> float:
        """The fat's modulus as it was under the probe."""
        return self.case.fat_kPa * self.stiffness

    @property
    def lump(self) -> bool:
        """Whether there is one."""
        return self.case.has_lump

    def outputs(self) -> dict[str, float]:
        """The outputs of the inverse model (`firmware_py.outputs`), in its order."""
        felt = {FORCE: self.F_N_per_m, FAT: self.fat_kPa}
        return {k: felt[k] if k in felt else getattr(self.case, k) for k in NAMES}


@dataclass(frozen=True)
class FrameStream:
    """A stroke as the wire carries it.

    Attributes
    ----------
    packed : list of bytes
        Each frame's geometry.FRAME_BYTES.
    counts : ndarray (n, cells)
        The same counts (float64 where Noise.quantise is False, then `packed` holds them rounded).
    positions_um, displacements_um, times_us : ndarray (n,), int
    truth : Truth
    press : int
        So many of the first frames are the press: the probe has touched the skin and does not move yet.
    """

    packed: list[bytes]
    counts: NDArray[Any]
    positions_um: NDArray[np.int64]
    displacements_um: NDArray[np.int64]
    times_us: NDArray[np.int64]
    truth: Truth
    press: int = 0

    def __len__(self) -> int:
        return len(self.packed)
