"""A first guess of the pressed state: plain tissue without a lump, a quarter of it by symmetry, costs next to
nothing.

Units: mm, kPa.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.solid.grid import lay_plain_grid
from palpate.sim.tissue.solid.run import SolidGeometry, SolidRun, set_up
from palpate.sim.tissue.state import State

Floats = NDArray[np.float64]


class PlainPress:
    """Presses on the tissue of a geometry as if no lump were in it.

    Parameters
    ----------
    case, settings
        The tissue, face and mesh sizes; the force of each press comes with it.
    geometry : SolidGeometry
        Where the states are wanted.
    """

    def __init__(self, case: Case, settings: Settings, geometry: SolidGeometry) -> None:
        self._target = geometry
        grid = geometry.mesh.grid
        self._plain = set_up(lay_plain_grid(grid, case, settings.hx_mm / settings.refine, settings.layer_mm))
        plain = replace(case, E_ratio=1.0, lump_stiffening=0.0)
        self._run = SolidRun(plain, settings, self._plain, 0.25, ())  # a rough load renews everything
        self._state: State | None = None

    def state(self, F_rel: float, position: float) -> State:
        """The guess for the target geometry, with the probe at `position`; loads only ever grow."""
        run = self._run
        self._state = run.load(self._state, 0.0, run.force(F_rel), rough=True)
        return self._carried(self._state, position)

    def _carried(self, state: State, position: float) -> State:
        ours, plain = self._target.mesh, self._plain.mesh
        lines = [np.unique(plain.nodes_mm[:, axis].round(9)) for axis in range(3)]
        u = state.u.reshape(-1, 3)[plain.node_lattice]
        x = ours.nodes_mm - [position, 0.0, 0.0]
        places = [np.abs(x[:, 0]), x[:, 1], np.abs(x[:, 2])]
        inside = np.stack([np.clip(p, line[0], line[-1]) for p, line in zip(places, lines)], -1)
        moved = RegularGridInterpolator(lines, u)(inside)
        moved[:, [0, 2]] *= np.sign(x[:, [0, 2]])
        moved[ours.fixed] = 0.0
        skin = RegularGridInterpolator((lines[0], lines[2]), state.multiplier.reshape(plain.surface.shape))
        top = ours.surface.ravel()
        multiplier = np.maximum(skin(inside[top][:, [0, 2]]), 0.0)
        return State(moved.ravel(), state.height, multiplier, self._pressures(state, x))

    def _pressures(self, state: State, x: Floats) -> Floats:
        """Coefficients of each element from the plain one at the same place, mirrored and scaled to its
        size."""
        ours, plain = self._target.mesh, self._plain.mesh
        grid = plain.grid
        middles = x[ours.elements].mean(1)
        where = [
            np.clip(np.searchsorted(line, value) - 1, 0, len(line) - 2)
            for line, value in zip(
                (grid.x, grid.y, grid.z), (np.abs(middles[:, 0]), middles[:, 1], np.abs(middles[:, 2]))
            )
        ]
        source = plain.element_lattice[tuple(where)]
        size = np.sqrt(self._target.integrals.volume / self._plain.integrals.volume[source])
        out = state.pressure[source] * size[:, None]
        out[:, [1, 3]] *= np.sign(middles[:, [0, 2]])
        return out
