"""Strokes over two lumps side by side, put together from those over one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.sim.probe.stroke_field import StrokeField
from palpate.sim.tissue import Stroke

Floats = NDArray[np.float64]
_LEAST_DEPTH_MM = 0.05

APART_MM = (7.0, 30.0)
"""Where two lumps look like one, and a little beyond."""

_SHARES = (0.4, 1.0)


class TwoLumps(StrokeField):
    """The field of one lump, half of `apart_mm` before its place, and of its like, as much behind it.

    What each changes of pressure and displacement over plain tissue is added up. That is exact where the
    lumps do not feel each other; at a distance near their diameter it is a likeness, no solution. The force
    is kept: neither change has any in sum.

    Parameters
    ----------
    *strokes : Stroke
        As for `StrokeField`.
    apart_mm : float
        Middle to middle.
    share : float
        How much the second changes, over what the first does.
    """

    def __init__(self, *strokes: Stroke, apart_mm: float, share: float = 1.0) -> None:
        super().__init__(*strokes)
        self.apart_mm, self.share = apart_mm, share

    def at(self, position_mm: Floats, force_N_per_m: Floats | None = None) -> tuple[Floats, Floats]:
        """Images and displacement; see `StrokeField.at`."""
        x = np.asarray(position_mm, float)
        first, first_mm = super().at(x + self.apart_mm / 2, force_N_per_m)
        other, other_mm = super().at(x - self.apart_mm / 2, force_N_per_m)
        plain, plain_mm = super().at(np.full_like(x, self.reach_mm[0]), force_N_per_m)
        image = np.maximum(first + self.share * (other - plain), 0)
        depth = first_mm + self.share * (other_mm - plain_mm)
        return image, np.maximum(depth, _LEAST_DEPTH_MM)


def random_pair(
    strokes: Sequence[Stroke], apart_mm: tuple[float, float], rng: np.random.Generator
) -> TwoLumps:
    """Two lumps, their distance even between the ends; the second changes .4 to 1 times what the first does.

    Where both ends are the same the lumps are equal.
    """
    low, high = apart_mm
    share = 1.0 if low == high else float(rng.uniform(*_SHARES))
    return TwoLumps(*strokes, apart_mm=float(rng.uniform(low, high)), share=share)
