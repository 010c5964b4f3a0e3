"""General sparse solvers for the tangent: CHOLMOD where cvxopt carries it, SciPy's SuperLU anywhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.mesh import TissueMesh
from palpate.sim.tissue.solver.linear import NotPositiveDefinite

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class SparseSystem:
    """Pattern of the tangent and the sum of its parts, lower triangle by columns."""

    def __init__(self, mesh: TissueMesh) -> None:
        self.free = np.nonzero(~mesh.fixed.ravel())[0]
        self.size = len(self.free)
        number = np.full(mesh.fixed.size, -1)
        number[self.free] = np.arange(self.size)
        dofs = number[np.concatenate([2 * mesh.elements, 2 * mesh.elements + 1], 1)]
        row, col = np.repeat(dofs, 18, axis=1).ravel(), np.tile(dofs, (1, 18)).ravel()
        self._used = np.nonzero((row >= col) & (col >= 0))[0]
        keys, self._place = np.unique(col[self._used] * self.size + row[self._used], return_inverse=True)
        self.columns, self.rows = (keys // self.size).astype(np.int32), (keys % self.size).astype(np.int32)
        self.starts = np.searchsorted(self.columns, np.arange(self.size + 1)).astype(np.int32)
        x, y = number[2 * mesh.surface], number[2 * mesh.surface + 1]
        pairs = np.stack([(x, x), (np.minimum(x, y), np.maximum(x, y)), (y, y)])  # (3, 2, S) column, row
        wanted = pairs[:, 0] * self.size + pairs[:, 1]
        self._contact_used = pairs[:, 0] >= 0
        self._contact_place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)

        self._K = np.zeros((len(mesh.elements), 18, 18))

    def change(self, K: Floats, which: Ints) -> None:
        """See `LinearSolver.change`."""
        self._K[which] = K[which]

    def values(self, contact: Floats) -> Floats:
        """Values of the lower triangle, in the order of `rows`."""
        data = np.bincount(self._place, self._K.ravel()[self._used], len(self.rows)).astype(float, copy=False)
        np.add.at(data, self._contact_place[self._contact_used], contact.T[self._contact_used])
        return data

    def expand(self, x: Floats, B: Floats) -> Floats:
        """Free values (n, k) put into vectors shaped like `B` (k, 2N)."""
        out = np.zeros_like(B)
        out[:, self.free] = x.T
        return out


class SuperLU:
    """SciPy's own sparse factorisation: slower, always there."""

    def __init__(self, mesh: TissueMesh) -> None:
        self.system = SparseSystem(mesh)
        self.change = self.system.change

    def factor(self, contact: Floats, position_mm: float) -> None:
        """See `LinearSolver.factor`. Definiteness is read off the pivots' signs."""
        from scipy import sparse
        from scipy.sparse.linalg import splu

        s = self.system
        lower = sparse.csc_matrix((s.values(contact), s.rows, s.starts), shape=(s.size, s.size))
        options = {"SymmetricMode": True}
        full = (lower + sparse.tril(lower, -1).T).tocsc()
        try:
            self._lu = splu(full, permc_spec="MMD_AT_PLUS_A", options=options, diag_pivot_thresh=0.0)
        except RuntimeError as error:
            raise NotPositiveDefinite(str(error)) from None
        if self._lu.U.diagonal().min() <= 0.0:
            raise NotPositiveDefinite("a pivot is not positive")

    def solve(self, B: Floats) -> Floats:
        """See `LinearSolver.solve`."""
        return self.system.expand(self._lu.solve(np.ascontiguousarray(B[:, self.system.free].T)), B)


class Cholmod:
    """Supernodal Cholesky of SuiteSparse, out of the cvxopt wheel (GPL, therefore optional)."""

    def __init__(self, mesh: TissueMesh) -> None:
        import cvxopt
        from cvxopt import cholmod

        self._cvxopt, self._cholmod = cvxopt, cholmod
        cholmod.options["supernodal"] = 2
        self.system = s = SparseSystem(mesh)
        self.change = s.change
        ones = cvxopt.matrix(np.ones(len(s.rows)))
        self._matrix = cvxopt.spmatrix(ones, s.rows.tolist(), s.columns.tolist(), (s.size, s.size))
        self._factor = cholmod.symbolic(self._matrix, uplo="L")

    def factor(self, contact: Floats, position_mm: float) -> None:
        """See `LinearSolver.factor`."""
        self._matrix.V = self._cvxopt.matrix(self.system.values(contact))
        try:
            self._cholmod.numeric(self._matrix, self._factor)
        except ArithmeticError:
            raise NotPositiveDefinite("the matrix is not positive definite") from None

    def solve(self, B: Floats) -> Floats:
        """See `LinearSolver.solve`."""
        x = self._cvxopt.matrix(B[:, self.system.free].T)
        self._cholmod.solve(self._factor, x)
        return self.system.expand(np.array(x), B)
