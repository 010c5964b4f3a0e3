"""Half a stroke continued to the other side: tissue and probe are symmetric. Units: mm, kPa."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Mirror:
    """How an array of a stroke looks from the other side of the lump.

    Attributes
    ----------
    axes : tuple of int
        Those that run the other way: 0 from position to position, 1 along the probe.
    sign : int
        -1 for places along the stroke.
    """

    axes: tuple[int, ...] = (0,)
    sign: int = 1

    def of(self, values: NDArray[Any]) -> NDArray[Any]:
        """The mirror image of `values`."""
        return self.sign * np.flip(values, self.axes)

    def continued(self, values: NDArray[Any], last_mm: float) -> NDArray[Any]:
        """`values` and their mirror image; what was felt right over the lump (`last_mm` = 0) stands once."""
        return np.concatenate([values, self.of(values)[1 if ends_over_lump(last_mm) else 0 :]])


SERIES = Mirror()
PLACES = Mirror(sign=-1)
IMAGES = Mirror(axes=(0, 1))
SPANS = Mirror(axes=(0, 1), sign=-1)
"""First and last place on the probe, position by position."""


def ends_over_lump(last_mm: float) -> bool:
    """Whether a stroke's last position is right over the lump."""
    return abs(last_mm) <= 1e-9


def both_sides(positions_mm: Floats, along_images: NDArray[Any], *series: Floats) -> tuple[Floats, ...]:
    """Positions (n,), images (n, rows, ...) and further series (n,) from one side of the lump to the other.

    Positions rise. A stroke that ends over the lump, or before it, is continued by its mirror image; one that
    goes on is given back as it is.
    """
    last = float(positions_mm[-1])
    if last > 0 and not ends_over_lump(last):
        return positions_mm, along_images, *series
    return (
        PLACES.continued(positions_mm, last),
        IMAGES.continued(along_images, last),
        *(SERIES.continued(values, last) for values in series),
    )
