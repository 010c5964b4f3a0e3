"""Half a stroke continued to the other side: tissue and probe are symmetric. Units: mm, kPa."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def both_sides(positions_mm: Floats, along_images: NDArray[Any], *series: Floats) -> tuple[Floats, ...]:
    """Positions (n,), images (n, rows, ...) and further series (n,) from one side of the lump to the other.

    Positions rise. A stroke that ends over the lump, or before it, is continued by its mirror image; one that
    goes on is given back as it is.
    """
    if positions_mm[-1] > 1e-9:
        return positions_mm, along_images, *series
    back = slice(-2, None, -1) if abs(positions_mm[-1]) < 1e-9 else slice(None, None, -1)
    return (
        np.concatenate([positions_mm, -positions_mm[back]]),
        np.concatenate([along_images, along_images[back, ::-1]]),
        *(np.concatenate([values, values[back]]) for values in series),
    )
