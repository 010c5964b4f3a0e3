"""What cases of the same shape share, set up once. Units: mm."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.element import ElementIntegrals, integrate
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.mesh import TissueMesh, build_mesh
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.solver.choice import make_solver
from palpate.sim.tissue.solver.linear import LinearSolver

_REMEMBERED = 3


@dataclass(frozen=True)
class Geometry:
    """What cases of the same shape share: mesh, integrals, the solver's analysis."""

    mesh: TissueMesh
    integrals: ElementIntegrals
    solver: LinearSolver


_local = threading.local()


def geometry_of(case: Case, settings: Settings, first: float, last: float) -> Geometry:
    """The geometry of a case, remembered per thread: stiffness and force do not change it."""
    memory: OrderedDict[tuple, Geometry] = _local.__dict__.setdefault("memory", OrderedDict())
    own_fat = case.fat_mm is not None and (case.fat_mm, case.has_lump)
    key = (case.d_mm, case.h, case.borders_mm, own_fat, case.reach_mm, settings, first, last)
    if key not in memory:
        mesh = build_mesh(case, settings, first, last)
        try:
            integrals = integrate(mesh)
        except ValueError as error:
            raise CaseError(f"{case.code} cannot be meshed: {error}") from None
        memory[key] = Geometry(mesh, integrals, make_solver(settings.solver, mesh))
        while len(memory) > _REMEMBERED:
            memory.popitem(last=False)
    memory.move_to_end(key)
    return memory[key]


def forget_geometries() -> None:
    """Forget what this thread has set up, to time a stroke from nothing."""
    _local.__dict__.clear()
