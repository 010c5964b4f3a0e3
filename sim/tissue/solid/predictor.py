"""Where Newton starts at the next position: the last states carried on. Units: mm, kPa.

As in the plane: near the skin displacement and pressure travel with the probe, near the lump they change
slowly where they are; in both frames a parabola through the last three positions is carried on, and between
skin and lump the two are blended. Outside the lump's box the mesh is a tensor grid, so its lattice can be
shifted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.solid import predictor_kernels as kernels
from palpate.sim.tissue.solid.mesh import SolidMesh
from palpate.sim.tissue.state import State, combine, extrapolation

Floats = NDArray[np.float64]

_PROBE = 0.05
"""Weight of the probe's frame: what the lump changes is small beside what the probe does."""


class SolidPredictor:
    """Carries states on from position to position.

    Parameters
    ----------
    mesh : SolidMesh
        Gives the lattice.
    volumes : ndarray (M,)
        Of the elements: the pressure coefficients belong to orthonormal functions.
    """

    def __init__(self, mesh: SolidMesh, volumes: Floats) -> None:
        grid = mesh.grid
        self._nodes, self._elements = mesh.node_lattice, mesh.element_lattice
        self._x = mesh.nodes_mm[mesh.surface[:, 0], 0]
        self._centre = self._x[1::2]
        self._root_volume = np.sqrt(volumes)
        self._held = np.nonzero(mesh.fixed.ravel())[0]
        self._surface_shape = mesh.surface.shape
        self._places = mesh.nodes_mm[np.maximum(self._nodes, 0)]
        self._middles = mesh.nodes_mm[mesh.elements].mean(1)[np.maximum(self._elements, 0)]
        self._top = grid.y[-1]
        self._node_lump = _lump_distance(self._places, grid.half_axes, grid.offset)
        self._element_lump = _lump_distance(self._middles, grid.half_axes, grid.offset)

    def __call__(self, history: Sequence[tuple[float, State]], position: float) -> State:
        """Guess the state at `position` from the last few, (position, state), the newest last."""
        places = [place for place, _ in history]
        weights = extrapolation(places, position)
        states = [state for _, state in history]
        u = combine(weights, [state.u for state in states])
        pressure = combine(weights, [state.pressure for state in states])
        rows = np.zeros((*self._nodes.shape, 3))
        cells = np.zeros((*self._elements.shape, 4))
        known_nodes = self._nodes >= 0
        known_cells = self._elements >= 0
        multiplier = np.zeros(self._surface_shape)
        last = np.zeros(self._surface_shape)
        for weight, state, place in zip(weights, states, places):
            by = position - place
            kernels.add_nodes(rows, known_nodes, weight, state.u, by, self._nodes, self._x)
            kernels.add_cells(
                cells,
                known_cells,
                weight,
                state.pressure,
                by,
                self._elements,
                self._centre,
                self._root_volume,
            )
            last = kernels.shifted(
                np.maximum(state.multiplier, 0.0).reshape(self._surface_shape), by, self._x
            )
            multiplier += weight * last
        node_share = _share(self._places, self._node_lump, self._top, position) * known_nodes
        cell_share = _share(self._middles, self._element_lump, self._top, position) * known_cells
        kernels.blend(u.reshape(-1, 3), rows, self._nodes, node_share)
        kernels.blend(pressure, cells, self._elements, cell_share)
        u[self._held] = 0.0
        multiplier = np.where(
            last > 0.0, np.maximum(multiplier, 0.25 * last), 0.0
        )  # what touches, goes on touching
        height = float(np.dot(weights, [state.height for state in states]))
        return State(u, height, multiplier.ravel(), pressure)


def _lump_distance(places: Floats, half_axes: tuple[float, float, float], offset: float) -> Floats:
    """About how far places (..., 3) lie from the lump's surface, mm; 0 inside it."""
    axes = np.array(half_axes)
    reach = np.linalg.norm((places - [0.0, 0.0, offset]) / axes, axis=-1)
    return np.maximum(reach - 1.0, 0.0) * axes.min()


def _share(places: Floats, lump: Floats, top: float, position: float) -> Floats:
    """How far places follow the probe: 1 at the skin under it, 0 at the lump and far from the probe.

    Either frame's error grows as the third power of the step over the distance to probe or lump.
    """
    away = np.abs(places[..., 0] - position)
    probe = np.hypot(top - places[..., 1], np.maximum(away - 8.0, 0.0))
    z = np.clip((36.0 - away) / 18.0, 0.0, 1.0)
    share = lump**3 / (lump**3 + _PROBE * probe**3 + 1e-12)
    return np.asarray(share * z * z * (3.0 - 2.0 * z))
