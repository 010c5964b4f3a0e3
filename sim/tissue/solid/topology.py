"""A solid mesh whose nodes move with the case while columns, rows, layers and shells stay what they are.

As in the plane (`palpate.sim.tissue.topology`): rows keep their share of what they lie in, nodes in the
lump's box go with lump and border. Columns and layers stand still, so the skin only rises or sinks.
Units: mm, as in `grid`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.solid.grid import SolidGrid
from palpate.sim.tissue.solid.mesh import SolidMesh, build_mesh

Floats = NDArray[np.float64]

_FOLLOWED_MM = 1e-6
"""A border so near to a line of the mesh is one that elements follow."""


class SolidTopology:
    """Meshes for the neighbourhood of a case.

    Parameters
    ----------
    case : Case
        The reference case.
    grid : SolidGrid
        Its grid, `lay_grid`.

    Raises
    ------
    CaseError
        A border between layers cuts elements: what its height does, the mesh does not follow.
    """

    def __init__(self, case: Case, grid: SolidGrid) -> None:
        assert grid.box is not None
        self._case, self._grid = case, grid
        (b0, b1), (below, above) = grid.box[1], _neighbours(case)
        inside = -case.half_down < case.border_mm < case.half_down
        lines = [grid.split] if inside else grid.y
        if case.has_lump and np.abs(np.asarray(lines) - case.border_mm).min() > _FOLLOWED_MM:
            raise CaseError(f"{case.code}: the border cuts elements, so lengths have no derivatives")
        self._inside = inside
        self._shares = (
            (-grid.y[b0] - case.half_down) / (-below - case.half_down),
            (grid.y[b1] - case.half_down) / (above - case.half_down),
        )
        self._knots = self._lines(case)

    def mesh(self, case: Case) -> SolidMesh:
        """The mesh of a case near the reference case, element for element.

        Raises
        ------
        CaseError
            It is so far off that lines would change places.
        """
        knots = self._lines(case)
        if len(knots) != len(self._knots) or (np.diff(knots) <= 0).any():
            raise CaseError(f"{case.code} is too unlike {self._case.code} for its mesh")
        along, across, down = case.half_axes_mm
        return build_mesh(
            replace(
                self._grid,
                y=np.interp(self._grid.y, self._knots, knots),
                half_axes=(along, down, across),
                offset=case.offset_mm,
                borders=case.borders_mm[:-1],
                split=case.border_mm if self._grid.split else 0.0,
            )
        )

    def _lines(self, case: Case) -> Floats:
        """Heights that rows keep their share between, upwards."""
        (below, above), r = _neighbours(case), case.half_down
        bottom = -r - self._shares[0] * (-below - r)
        top = r + self._shares[1] * (above - r)
        split = case.border_mm if self._grid.split else 0.0
        lines = [*case.borders_mm[1:], bottom, split, top, case.centre_mm]
        if not self._inside and np.abs(np.array([bottom, top]) - case.border_mm).min() > _FOLLOWED_MM:
            lines.append(case.border_mm)
        return np.sort(lines)


def _neighbours(case: Case) -> tuple[float, float]:
    """Heights of the next borders, or the skin, under and over the lump."""
    border, floor, r = case.border_mm, case.borders_mm[1], case.half_down
    return (border if border <= -r else floor), (border if border >= r else case.centre_mm)
