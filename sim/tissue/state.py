"""An equilibrium's unknowns, and how the last few are carried on to the next position. Units: mm, kPa."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass
class State:
    """Unknowns of one equilibrium, in the plane or in space.

    Attributes
    ----------
    u : ndarray (2N,) or (3N,)
        Displacement, mm.
    height : float
        Height of the probe's lowest point, mm.
    multiplier : ndarray (S,)
        Contact multipliers of the surface's nodes, kPa.
    pressure : ndarray (M, 3) or (M, 4)
        Coefficients of the elements' pressure.
    smallest_jacobian : float
        Of an equilibrium that Newton's method found: least det F at any Gauss point; below 0 is inverted.
    """

    u: Floats
    height: float
    multiplier: Floats
    pressure: Floats
    smallest_jacobian: float = math.nan

    def copy(self) -> State:
        """A state that can be changed without changing this one."""
        return State(self.u.copy(), self.height, self.multiplier.copy(), self.pressure.copy())


def extrapolation(places: Sequence[float], position: float) -> list[float]:
    """Lagrange's weights of what is known at `places`, for its value at `position`."""
    return [
        math.prod(((position - other) / (place - other) for other in places if other != place), start=1.0)
        for place in places
    ]


def combine(weights: Sequence[float], arrays: Sequence[Floats]) -> Floats:
    """The weighted sum of arrays of one shape."""
    out = weights[0] * arrays[0]
    for weight, array in zip(weights[1:], arrays[1:]):
        out += weight * array
    return out
