"""A mesh that keeps its nodes and elements while the case changes: every result is smooth in every length.

`mesh.build_mesh` chooses how many columns, rows and rings a case needs, so a slightly larger lump may get
another mesh and its pressures jump by the meshes' errors. Here these numbers are chosen once, for a reference
case. For other cases the lines of its grid move: columns stay, rows keep their share of the layer that they
lie in. Units: mm, origin in the middle of the lump, y upwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue import grid as grids
from palpate.sim.tissue.case import Case
from palpate.sim.tissue.element import integrate
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.geometry import Geometry
from palpate.sim.tissue.grid import Grid, lay_grid
from palpate.sim.tissue.mesh import TissueMesh, build_mesh, corners_of, meshed, with_corners
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.solver.choice import make_solver
from palpate.sim.tissue.solver.linear import LinearSolver

Floats = NDArray[np.float64]

_WIDEST, _NARROWEST = 2.2, 0.45
"""How far a layer's rows may stretch or shrink against the reference case's."""

_LEAST_RING = 0.35
"""Of the reference case's ring between the lump and the columns beside it, so much must remain."""


class OutsideTopology(CaseError):
    """The case is too far from the reference case for its mesh; another topology will do."""


@dataclass(frozen=True)
class _Lines:
    """Heights of the lines that a case's rows lie between, ascending, and where the lump meets the border."""

    knots: Floats
    line: float


class Topology:
    """Nodes and elements for the neighbourhood of a case.

    Parameters
    ----------
    case : Case
        The reference case: its mesh is `build_mesh`'s.
    settings : Settings
    first_mm, last_mm : float
        Where the probe may stand.

    Raises
    ------
    CaseError
        The reference case cannot be meshed.
    """

    def __init__(self, case: Case, settings: Settings, first_mm: float, last_mm: float) -> None:
        self.case, self.settings = meshed(case), settings
        self.span_mm = (first_mm, last_mm)
        self._grid = lay_grid(self.case, settings, first_mm, last_mm)
        self._mesh = build_mesh(case, settings, first_mm, last_mm)
        self._place = _place_of(self.case)
        self._top_share, self._bottom_share = self._shares()
        self._lines = self._lines_of(self.case)

    @cached_property
    def solver(self) -> LinearSolver:
        """One for all cases: its analysis knows nodes and elements, not places."""
        return make_solver(self.settings.solver, self._mesh)

    @cached_property
    def precise(self) -> LinearSolver:
        """Another, for derivatives."""
        return make_solver(self.settings.solver, self._mesh, precise=True)

    def grid(self, case: Case) -> Grid:
        """The reference grid with its lines moved to where `case` has them.

        Raises
        ------
        OutsideTopology
            The lump would leave its columns, the border would enter or leave the lump, or rows would become
            more than twice as high or less than half.
        """
        case = meshed(case)
        if _place_of(case) != self._place:
            raise OutsideTopology(f"{case.code}: the border has entered or left the lump")
        if len(case.layers) != len(self.case.layers):
            raise OutsideTopology(f"{case.code}: its layers are others than those of {self.case.code}")
        before, after = self._grid, self._lines_of(case)
        stretched = np.diff(after.knots) / np.diff(self._lines.knots)
        if not (stretched > _NARROWEST).all() or not (stretched < _WIDEST).all():
            raise OutsideTopology(f"{case.code}: its layers are too unlike {self.case.code}")
        half, r = before.x[before.box_x[1]], case.d_mm / 2
        if half - r < _LEAST_RING * (half - before.radius) or r < 0.6 * before.radius:
            raise OutsideTopology(f"{case.code}: its lump is too unlike {self.case.code}")
        return replace(
            before,
            y=np.interp(before.y, self._lines.knots, after.knots),
            radius=r,
            borders=case.borders_mm[:-1],
            turns=grids.turns(after.line / r),
        )

    def mesh(self, case: Case) -> TissueMesh:
        """The mesh of `case`, node for node and element for element that of the reference case.

        Raises
        ------
        OutsideTopology
            As `grid`.
        """
        grid = self.grid(case)
        return with_corners(self._mesh, corners_of(grid), grid)

    def geometry(self, case: Case) -> Geometry:
        """Mesh, integrals and solver of `case`; only one of a topology's geometries can be solved at a time.

        Raises
        ------
        CaseError
            As `grid`, or an element is folded over.
        """
        mesh = self.mesh(case)
        return Geometry(mesh, integrate(mesh), self.solver)

    def _shares(self) -> tuple[float, float]:
        """Where the box's lower and upper side stand between the lump and the next line."""
        g = self._grid
        (j0, j1), r = g.box_y, g.radius
        below, above = self._neighbours(self.case)
        return (g.y[j1] - r) / (above - r), (-g.y[j0] - r) / (-below - r)

    def _neighbours(self, case: Case) -> tuple[float, float]:
        """The next lines under and over the lump."""
        border, gland_ends = case.borders_mm[:2]
        above = (
            border if self._place == "gland" else case.centre_mm - sum(grids.skin_rows(case, self.settings))
        )
        return (border if self._place == "fat" else gland_ends), above

    def _lines_of(self, case: Case) -> _Lines:
        r, border, skin = case.d_mm / 2, case.border_mm, grids.skin_rows(case, self.settings)
        below, above = self._neighbours(case)
        top, bottom = r + self._top_share * (above - r), -r - self._bottom_share * (-below - r)
        line = border if self._place == "meets" else 0.0
        deeper = sorted(case.borders_mm[1:])
        knots = [*deeper, bottom, line, top, case.centre_mm - sum(skin), case.centre_mm]
        if self._place == "gland" and self._top_share < 1 - 1e-9:
            knots.insert(-2, border)
        elif self._place == "fat" and self._bottom_share < 1 - 1e-9:
            knots.insert(len(deeper), border)
        return _Lines(np.array(knots), line)


def follow(
    last: Topology | None, case: Case, settings: Settings, first_mm: float, last_mm: float
) -> tuple[Topology, Geometry]:
    """The geometry of a case by the last topology where that will do, otherwise by one of its own.

    Raises
    ------
    CaseError
        The case cannot be meshed.
    """
    if last is not None and last.settings == settings:
        try:
            return last, last.geometry(case)
        except OutsideTopology:
            pass
    own = Topology(case, settings, first_mm, last_mm)
    return own, own.geometry(case)


def _place_of(case: Case) -> str:
    """Where the lump lies for the mesh: the border meets it, or it is in the "fat" or in the "gland"."""
    if grids.meets(case.border_mm, case.d_mm / 2):
        return "meets"
    return "gland" if case.border_mm > 0 else "fat"
