"""Where Newton starts at the next position: the last state moved along with the probe. Units: mm, kPa.

Over the lump's box the mesh is a tensor grid, so displacement and pressure of its rows can be shifted with
the probe; below it they are taken as they are. Without this Newton needs twice as many iterations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.tissue.mesh import TissueMesh

Floats = NDArray[np.float64]


@dataclass
class State:
    """Unknowns of one equilibrium.

    Attributes
    ----------
    u : ndarray (2N,)
        Displacement, mm.
    height : float
        Height of the probe's lowest point, mm.
    multiplier : ndarray (S,)
        Contact multipliers of the surface's nodes, kPa.
    pressure : ndarray (M, 3)
        Coefficients of the elements' pressure.
    """

    u: Floats
    height: float
    multiplier: Floats
    pressure: Floats

    def copy(self) -> State:
        """A state that can be changed without changing this one."""
        return State(self.u.copy(), self.height, self.multiplier.copy(), self.pressure.copy())


class Shift:
    """Moves states by a fixed distance to the right.

    Parameters
    ----------
    mesh : TissueMesh
        Gives the rows.
    areas : ndarray (M,)
        Areas of the elements: the pressure coefficients belong to orthonormal functions.
    distance_mm : float
        How far.
    """

    def __init__(self, mesh: TissueMesh, areas: Floats, distance_mm: float) -> None:
        self._rows, self._cells = mesh.node_rows, mesh.element_rows
        x = mesh.nodes_mm[self._rows[0], 0]
        wanted = np.clip(x - distance_mm, x[0], x[-1])
        self._from = np.clip(np.searchsorted(x, wanted, side="right") - 1, 0, len(x) - 2)
        self._weight = ((wanted - x[self._from]) / (x[self._from + 1] - x[self._from]))[None, :, None]
        centre = x[1::2]
        self._cell_from = np.searchsorted((centre[1:] + centre[:-1]) / 2, centre - distance_mm)
        self._scale = np.sqrt(areas[self._cells] / areas[self._cells[:, self._cell_from]])[:, :, None]
        self._surface, self._distance, self._fixed = x, distance_mm, mesh.fixed.ravel()

    def __call__(self, state: State) -> State:
        """The shifted state."""
        moved = state.u.reshape(-1, 2).copy()
        rows = moved[self._rows]
        moved[self._rows] = rows[:, self._from] * (1 - self._weight) + rows[:, self._from + 1] * self._weight
        u = moved.ravel()
        u[self._fixed] = 0.0
        pressure = state.pressure.copy()
        pressure[self._cells] = state.pressure[self._cells[:, self._cell_from]] * self._scale
        x = self._surface
        multiplier = np.interp(x, x + self._distance, np.maximum(state.multiplier, 0.0), left=0.0, right=0.0)
        return State(u, state.height, multiplier, pressure)
