"""The slow part of what a sensor reads: it goes on rising under a pressure that does not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LAG_MM = 18.0
"""Travel in the time constant: .3 s at 60 mm/s."""


class Lag:
    """First-order lag; it goes on from where the last call ended."""

    def __init__(self) -> None:
        self._now: Floats | None = None
        self._at_mm = 0.0

    def follow(self, pressure_kPa: Floats, stroke_mm: Floats) -> Floats:
        """`pressure_kPa` (n, ...) as it lags behind, at places `stroke_mm` (n,)."""
        out = np.empty_like(pressure_kPa)
        for k, (p, x) in enumerate(zip(pressure_kPa, stroke_mm)):
            if self._now is None:
                self._now = p
            else:
                a = np.exp(-abs(x - self._at_mm) / LAG_MM)
                self._now = a * self._now + (1 - a) * p
            self._at_mm = float(x)
            out[k] = self._now
        return out
