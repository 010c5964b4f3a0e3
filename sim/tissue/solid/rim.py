"""The rim of the contact: elements under skin that the face reaches or leaves when it moves on.

A tangent goes on being used at the next position, where some of the skin is free. With the pressure that it
bore, whose geometric term softens it, free skin would be unstable: errors grow tenfold a step. So that
pressure is left out there: at the tangent's own position that costs few iterations or none. Units: mm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.solid.mesh import SolidMesh

Ints = NDArray[np.int64]

_DEEP_MM = 3.0
_SHARE = 0.3
"""Of the contact's length, for that of light forces."""


class Rim:
    """The rims of contacts on one mesh.

    Parameters
    ----------
    mesh : SolidMesh
    reach_mm : float
        How far from the contact's ends along the stroke.
    """

    def __init__(self, mesh: SolidMesh, reach_mm: float) -> None:
        middles = mesh.nodes_mm[mesh.elements].mean(1)
        skin = mesh.nodes_mm[mesh.surface]
        self._reach = reach_mm
        self._shape = mesh.surface.shape
        self._lines_x = skin[:, 0, 0]
        self._elements = np.nonzero(mesh.grid.y[-1] - middles[:, 1] < _DEEP_MM)[0]
        self._x = middles[self._elements, 0]
        self._row = np.abs(middles[self._elements, 2, None] - skin[0, :, 2]).argmin(1)

    def elements(self, active: Ints) -> Ints:
        """Those of the contact of the skin's nodes `active`, by their numbers among the skin's."""
        touching = np.zeros(self._shape, np.bool_)
        touching.flat[active] = True
        first = self._lines_x[touching.argmax(0)]
        last = self._lines_x[::-1][touching[::-1].argmax(0)]  # before the first where nothing touches
        reach = np.minimum(self._reach, _SHARE * (last - first))[self._row]
        near = [np.abs(self._x - end[self._row]) < reach for end in (first, last)]
        return self._elements[near[0] | near[1]]
