"""Choosing the solver for the tangent by its name."""

from __future__ import annotations

from sim.tissue.errors import CaseError
from sim.tissue.linear import LinearSolver
from sim.tissue.mesh import TissueMesh
from sim.tissue.sparse import Cholmod, SuperLU
from sim.tissue.strip import StripCholesky


def make_solver(name: str, mesh: TissueMesh) -> LinearSolver:
    """The back-end called `name`; `auto` is `strip`, which needs nothing but SciPy and numba.

    Raises
    ------
    CaseError
        CHOLMOD is asked for and cvxopt is not installed.
    """
    if name == "superlu":
        return SuperLU(mesh)
    if name == "cholmod":
        try:
            return Cholmod(mesh)
        except ImportError:
            raise CaseError("solver cholmod needs the package cvxopt; install palpate[fast]") from None
    return StripCholesky(mesh)
