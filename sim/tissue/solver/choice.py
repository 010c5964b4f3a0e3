"""Choosing the solver for the tangent by its name."""

from __future__ import annotations

import numpy as np

from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.mesh import TissueMesh
from palpate.sim.tissue.solver.linear import LinearSolver
from palpate.sim.tissue.solver.sparse import Cholmod, SuperLU
from palpate.sim.tissue.solver.strip import StripCholesky


def make_solver(name: str, mesh: TissueMesh, precise: bool = False) -> LinearSolver:
    """The back-end called `name`; `auto` is `strip`, which needs nothing but SciPy and numba.

    The reference stroke needs none and gets SuperLU.

    Parameters
    ----------
    precise : bool
        In double precision, for derivatives; Newton's method corrects what single precision leaves.

    Raises
    ------
    CaseError
        CHOLMOD is asked for and cvxopt is not installed.
    """
    if name in ("superlu", "reference"):
        return SuperLU(mesh)
    if name == "cholmod":
        try:
            return Cholmod(mesh)
        except ImportError:
            raise CaseError("solver cholmod needs the package cvxopt; install palpate[fast]") from None
    return StripCholesky(mesh, np.float64 if precise else np.float32)
