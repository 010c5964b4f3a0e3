"""Where Newton starts at the next position: the last states carried on. Units: mm, kPa.

Near the surface, displacement and pressure travel with the probe: over the lump's box the mesh is a tensor
grid, so its rows can be shifted. Near the lump and below they change slowly where they are. In both frames a
parabola through the last three positions is carried on, and between surface and lump the two are blended.
Without this Newton needs three times the work.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue import predictor_kernels as kernels
from palpate.sim.tissue.mesh import TissueMesh
from palpate.sim.tissue.state import State, combine, extrapolation

Floats = NDArray[np.float64]


class Predictor:
    """Carries states on from position to position.

    Parameters
    ----------
    mesh : TissueMesh
        Gives the rows.
    areas : ndarray (M,)
        Areas of the elements: the pressure coefficients belong to orthonormal functions.
    """

    def __init__(self, mesh: TissueMesh, areas: Floats) -> None:
        self._rows, self._cells = mesh.node_rows, mesh.element_rows
        self._x = mesh.nodes_mm[self._rows[0], 0]
        self._centre = self._x[1::2]
        self._root_area = np.sqrt(areas[self._cells])
        self._held = np.nonzero(mesh.fixed.ravel())[0]
        row_y = mesh.nodes_mm[self._rows[:, 0], 1]
        self._node_share = _share_of_probe(row_y, row_y[-1], mesh.lump_radius_mm)
        cell_y = row_y[1::2]
        self._cell_share = _share_of_probe(cell_y, row_y[-1], mesh.lump_radius_mm)

    def __call__(self, history: Sequence[tuple[float, State]], position: float) -> State:
        """Guess the state at `position` from the last few, (position, state), the newest last."""
        places = [place for place, _ in history]
        weights = extrapolation(places, position)
        states = [state for _, state in history]
        moved_u = combine(weights, [state.u for state in states])
        pressure = combine(weights, [state.pressure for state in states])
        shifts = [position - place for place in places]
        near = _share_near(self._x - position)
        inside = np.nonzero(near)[0]
        first = int(inside[0]) // 2 * 2  # a corner
        last = min(int(inside[-1]) // 2 * 2 + 2, len(self._x) - 1)  # ends with a mid-side, inside the tissue
        rows = np.zeros((len(self._rows), last - first, 2))
        cells = np.zeros((len(self._cells), (last - first) // 2, 3))
        for weight, state, by in zip(weights, states, shifts):
            kernels.add_rows(rows, weight, state.u, by, self._rows, self._x, first)
            kernels.add_cells(
                cells, weight, state.pressure, by, self._cells, self._centre, self._root_area, first // 2
            )
        near = near[first:last]
        kernels.blend_rows(moved_u, rows, self._rows, self._node_share, near, first)
        kernels.blend_cells(pressure, cells, self._cells, self._cell_share, near[1::2], first // 2)
        moved_u[self._held] = 0.0
        moved = [
            np.interp(self._x, self._x + by, np.maximum(state.multiplier, 0.0), left=0.0, right=0.0)
            for state, by in zip(states, shifts)
        ]
        multiplier = np.where(moved[-1] > 0.0, np.maximum(combine(weights, moved), 0.0), 0.0)
        height = float(np.dot(weights, [state.height for state in states]))
        return State(moved_u, height, multiplier, pressure)


def _share_of_probe(y: Floats, top: float, radius: float) -> Floats:
    """How far heights `y` follow the probe: 1 at the surface, 0 on the lump.

    Either frame's error grows as the third power of the step over the distance to surface or lump.
    """
    depth, height = (top - y) ** 3, np.maximum(y - radius, 0.0) ** 3
    return height / (height + depth + 1e-12)


def _share_near(distance: Floats) -> Floats:
    """1 within 15 mm of the probe, 0 beyond 30 mm, where the columns widen and nothing moves."""
    z = np.clip((30.0 - np.abs(distance)) / 15.0, 0.0, 1.0)
    return z * z * (3.0 - 2.0 * z)
