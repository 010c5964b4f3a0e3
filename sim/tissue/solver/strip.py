"""A Cholesky factorisation made for this mesh: a long strip of narrow columns.

Columns are eliminated from both ends towards a front under the probe. Between columns only the Schur
complement of a front's sixty to ninety unknowns is carried on, dense, so that most of the work is done by
LAPACK on small matrices in the cache. Element middles are eliminated in their element, mid-sides inside a
column in their banded order. Every front's complement is kept: a tangent that changed in a few columns
needs new work only from these to the root.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.mesh import TissueMesh
from palpate.sim.tissue.solver import strip_factor, strip_solve, strip_solve_many, strip_tangent
from palpate.sim.tissue.solver.lapack import lapack
from palpate.sim.tissue.solver.linear import NotPositiveDefinite
from palpate.sim.tissue.solver.strip_layout import CORNERS_AND_SIDES, MIDDLE, lay_out_chain, lay_out_columns

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FEW = 2
"""Right-hand sides of a step of Newton's method; more go side by side."""


class StripCholesky:
    """Solver for the tangent of one mesh; see `linear.LinearSolver`.

    Parameters
    ----------
    precision : type
        Of the factor: single precision takes four fifths of a stroke's time, and as many iterations.
    """

    def __init__(self, mesh: TissueMesh, precision: type[np.floating] = np.float32) -> None:
        self._precision, self._lapack = precision, tuple(lapack(precision is np.float32))
        self._columns = lay_out_columns(mesh)
        self._chains = (lay_out_chain(mesh, self._columns, False), lay_out_chain(mesh, self._columns, True))
        nodes = mesh.elements[:, CORNERS_AND_SIDES]
        self._outer = np.concatenate([2 * nodes, 2 * nodes + 1], 1)
        self._middle = 2 * mesh.elements[:, MIDDLE]
        self._held = np.nonzero(mesh.fixed.ravel())[0]
        self._count = count = len(self._chains[0].size)
        self._condensed = np.zeros((len(mesh.elements), 2, 18), precision)
        self._packed = np.zeros((len(mesh.elements), 136), precision)
        front = max(int((c.size - c.pivots).max()) for c in self._chains)
        schur = np.empty((2, count, front, front), precision)
        self._factors = [
            strip_factor.Factor(
                np.zeros((c.stride, c.stride), precision), np.empty(c.row_starts[-1], precision), kept
            )
            for c, kept in zip(self._chains, schur)
        ]
        self._middles_mm = _column_middles(mesh)
        self._column_of_surface = np.empty(len(mesh.surface), np.int64)
        starts = self._columns.surface_starts
        self._column_of_surface[self._columns.surface] = np.repeat(np.arange(count), np.diff(starts))
        self._column_of_element = mesh.column
        self._contact = np.zeros((len(mesh.surface), 3))
        self._valid = [0, 0]
        self._root = count // 2

    def change(self, K: Floats, which: Ints) -> None:
        """See `LinearSolver.change`."""
        if not len(which):
            return
        self._invalidate(self._column_of_element[which])
        if not strip_tangent.condense_elements(K, which, self._condensed, self._packed):
            self._valid = [0, 0]
            raise NotPositiveDefinite("an element's middle is not stable")

    def factor(self, contact: Floats, position_mm: float) -> None:
        """See `LinearSolver.factor`. Only columns from the first change to the root are done again."""
        touched = np.nonzero((contact != self._contact).any(1))[0]
        if len(touched):
            self._invalidate(self._column_of_surface[touched])
            self._contact = contact.copy()
        self._root = min(int(np.searchsorted(self._middles_mm, position_mm)), self._count - 2)
        tangent = tuple(strip_tangent.Tangent(self._packed, contact))
        for side, end in enumerate((self._root + 1, self._count - self._root - 1)):
            good = strip_factor.eliminate(
                self._valid[side], end, side == 1, tangent, tuple(self._columns), tuple(self._chains[side]),
                tuple(self._factors[side]), self._lapack,
            )  # fmt: skip
            self._valid[side] = max(self._valid[side], end) if good else 0
            if not good:
                raise NotPositiveDefinite("a pivot is not positive")
        if not self._factor_root():
            raise NotPositiveDefinite("a pivot is not positive")

    def _invalidate(self, columns: Ints) -> None:
        """Forget what these columns went into."""
        self._valid[0] = min(self._valid[0], int(columns.min()))
        self._valid[1] = min(self._valid[1], self._count - 1 - int(columns.max()))

    def _factor_root(self) -> bool:
        left, right = self._chains
        here, there = self._root, self._count - 2 - self._root
        self._root_dofs = left.dofs[here, left.pivots[here] : left.size[here]]
        theirs = right.dofs[there, right.pivots[there] : right.size[there]]
        place = {dof: i for i, dof in enumerate(self._root_dofs.tolist())}
        match = np.array([place[dof] for dof in theirs.tolist()])
        n = len(match)
        self._root_rows = np.zeros((n, n), self._precision)
        left_schur, right_schur = self._factors[0].schur[here], self._factors[1].schur[there]
        return bool(strip_factor.join(left_schur, right_schur, match, self._root_rows, n, self._lapack))

    def solve(self, B: Floats) -> Floats:
        """See `LinearSolver.solve`."""
        if len(B) > _FEW:
            x = np.ascontiguousarray(B.T, self._precision)
            self._substitute(strip_solve_many, x)
            return np.ascontiguousarray(x.T, np.float64)
        x = np.array(B, self._precision)
        self._substitute(strip_solve, x)
        return x.astype(np.float64)

    def _substitute(self, kernels: ModuleType, x: Floats) -> None:
        """Forwards and backwards, in place, by the loops of this module, which says how x is laid out."""
        steps = (self._root + 1, self._count - self._root - 1)
        kernels.forward_elements(x, self._outer, self._middle, self._condensed)
        (x if kernels is strip_solve_many else x.T)[self._held] = 0.0
        for c, f, count in zip(self._chains, self._factors, steps):
            kernels.forward(x, count, c.dofs, c.interior, c.pivots, c.size, c.spans, c.row_starts, f.rows)
        kernels.solve_root(x, self._root_dofs, self._root_rows)
        for c, f, count in zip(self._chains, self._factors, steps):
            kernels.backward(x, count, c.dofs, c.interior, c.pivots, c.size, c.spans, c.row_starts, f.rows)
        kernels.backward_elements(x, self._outer, self._middle, self._condensed)


def _column_middles(mesh: TissueMesh) -> Floats:
    """Mean x of every column, ascending."""
    x = mesh.nodes_mm[mesh.elements[:, MIDDLE], 0]
    return np.bincount(mesh.column, x) / np.bincount(mesh.column)
