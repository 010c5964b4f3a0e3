"""Cholesky's factorisation of the solid tangent: single precision, front by front, renewed where it has
changed.

The residual stays in double precision, so the equilibrium's digits do not depend on the factor's; but a
factor in single precision takes half of the time and memory. Fronts over which nothing has changed are
kept.
"""

# mypy: ignore-errors
from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit
from numba.extending import get_cython_function_address
from numpy.typing import NDArray

from palpate.sim.tissue.solid.fronts import Fronts
from palpate.sim.tissue.solver.lapack import call
from palpate.sim.tissue.solver.linear import NotPositiveDefinite

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

MOST_SIDES = 64
"""Right-hand sides that are solved for together."""


class Multifrontal:
    """The factor of one mesh's tangent.

    Parameters
    ----------
    fronts : Fronts
        Its layout.
    """

    def __init__(self, fronts: Fronts) -> None:
        self.fronts = fronts
        self.contact = np.zeros((len(fronts.contact_rows), 3, 3), np.float32)
        self.flops = 0.0
        self._panels = np.empty(fronts.panel_start[-1], np.float32)
        self._rests = np.empty(fronts.rest_start[-1], np.float32)
        largest = int(fronts.size.max())
        self._square = np.empty(largest * largest, np.float32)
        self._sides = np.empty(largest * MOST_SIDES, np.float32)
        self._dirty = np.ones(len(fronts.size), np.bool_)

    def change_elements(self, which: NDArray[np.int64]) -> None:
        """The stiffness of these elements has changed since the last factorisation."""
        self._dirty[self.fronts.front_of_element[which]] = True

    def change_contact(self, blocks: Singles) -> None:
        """The contact adds `blocks` (S, 3, 3) to the tangent."""
        changed = (blocks != self.contact).any((1, 2))
        self._dirty[self.fronts.front_of_contact[changed]] = True
        self.contact = blocks

    def factor(self, K: Singles) -> None:
        """Factor the tangent of the element stiffnesses K (M, 81, 81), upper triangles.

        Raises
        ------
        NotPositiveDefinite
            It has no Cholesky factor; everything is to be factored anew.
        """
        f = self.fronts
        _spread(self._dirty, f.parent)
        self.flops = float(f.work[self._dirty].sum())
        good = _factor(
            self._dirty, f.size, f.pivots, f.panel_start, f.rest_start, f.child_start, f.child,
            f.element_start, f.element, f.element_rows, f.up_start, f.up, f.run_start, f.run,
            f.contact_start, f.contact, f.contact_rows, K, self.contact, self._panels, self._rests,
            self._square, *_constants(),
        )  # fmt: skip
        self._dirty[:] = not good
        if not good:
            raise NotPositiveDefinite

    def solve(self, sides: Floats) -> Floats:
        """Solutions (n, 3N) for right-hand sides (n, 3N); what is held stays as it is."""
        f = self.fronts
        out = np.asarray(sides, np.float32).copy()
        for first in range(0, len(out), MOST_SIDES):
            _solve(
                f.size, f.pivots, f.panel_start, f.dofs_start, f.dofs, self._panels,
                out[first : first + MOST_SIDES], self._sides, *_constants(),
            )  # fmt: skip
        return out.astype(np.float64)


_LETTERS = np.frombuffer(b"LRTN", np.uint8).copy()
_NUMBERS = np.array([1.0, -1.0], np.float32)


@cache
def _routines() -> np.ndarray:
    """Addresses of spotrf, strsm, ssyrk, sgemm, strsv and sgemv."""
    blas = [
        get_cython_function_address("scipy.linalg.cython_blas", name)
        for name in ("strsm", "ssyrk", "sgemm", "strsv", "sgemv")
    ]
    return np.array([get_cython_function_address("scipy.linalg.cython_lapack", "spotrf"), *blas], np.int64)


def _constants() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return _routines(), _LETTERS, _NUMBERS


@njit(cache=True, nogil=True)
def _spread(dirty, parent):
    """What is over a changed front changes with it."""
    for f in range(len(dirty)):
        if dirty[f] and parent[f] >= 0:
            dirty[parent[f]] = True


@njit(cache=True, nogil=True)
def _factor(
    dirty, size, pivots, panel_start, rest_start, child_start, child, element_start, element, element_rows,
    up_start, up, run_start, run, contact_start, contact, contact_rows, K, blocks, panels, rests, square,
    routines, letters, numbers,
):  # fmt: skip
    """Renew the dirty fronts; False if a pivot is not positive."""
    sizes = np.zeros(4, np.int32)
    for f in range(len(size)):
        if not dirty[f]:
            continue
        n = size[f]
        A = square[: n * n].reshape(n, n)
        for i in range(n):
            for j in range(i, n):
                A[i, j] = 0.0
        for k in range(element_start[f], element_start[f + 1]):
            _add_block(A, K[element[k]], element_rows[k])
        for k in range(contact_start[f], contact_start[f + 1]):
            _add_block(A, blocks[contact[k]], contact_rows[contact[k]])
        for k in range(child_start[f], child_start[f + 1]):
            c = child[k]
            _extend(
                A, rests[rest_start[c] : rest_start[c + 1]], up[up_start[c] : up_start[c + 1]],
                run[run_start[c] : run_start[c + 1]],
            )  # fmt: skip
        p = pivots[f]
        if not _eliminate(A, p, routines, letters, numbers, sizes):
            return False
        panel = panels[panel_start[f] : panel_start[f + 1]]
        for i in range(p):
            for j in range(i, n):
                panel[i * n + j] = A[i, j]
        rest = rests[rest_start[f] : rest_start[f + 1]]
        k = 0
        for i in range(p, n):
            for j in range(i, n):
                rest[k + j - i] = A[i, j]
            k += n - i
    return True


@njit(cache=True, nogil=True, inline="always")
def _add_block(A, block, rows):
    """Add the upper triangle of a block to that of A; rows below 0 are held."""
    for i in range(len(rows)):
        a = rows[i]
        if a >= 0:
            for j in range(i, len(rows)):
                b = rows[j]
                if b >= 0:
                    A[min(a, b), max(a, b)] += block[i, j]


@njit(cache=True, nogil=True)
def _extend(A, rest, up, run):
    """Add a child's rest, a packed upper triangle, to A; its rows go up in runs of neighbours."""
    m = len(up)
    for r in range(len(run) - 1):
        for i in range(run[r], run[r + 1]):
            target = A[up[i]]
            row = rest[i * m - i * (i - 1) // 2 :]  # from column i on
            for s in range(r, len(run) - 1):
                first = max(run[s], i)
                to = target[up[run[s]] + first - run[s] :]
                come = row[first - i : run[s + 1] - i]
                for j in range(len(come)):
                    to[j] += come[j]


@njit(cache=True, nogil=True)
def _eliminate(A, p, routines, letters, numbers, sizes):
    """The first p rows of the upper triangle A become U; the rest, the Schur complement."""
    # Row-major upper is LAPACK's column-major lower, so nothing is copied.
    n = A.shape[0]
    sizes[0] = p
    sizes[1] = n
    sizes[2] = n - p
    sizes[3] = 0
    if p == 0:
        return True
    base = A.ctypes.data
    size = sizes.ctypes.data
    letter = letters.ctypes.data
    one = numbers.ctypes.data
    lower, right, transposed, plain = letter, letter + 1, letter + 2, letter + 3
    call(routines[0], (lower, size, base, size + 4, size + 12))
    if sizes[3] != 0:
        return False
    if n > p:
        below = base + 4 * p
        call(
            routines[1],
            (right, lower, transposed, plain, size + 8, size, one, base, size + 4, below, size + 4),
        )
        corner = base + 4 * p * (n + 1)
        call(routines[2], (lower, plain, size + 8, size, one + 4, below, size + 4, one, corner, size + 4))
    return True


@njit(cache=True, nogil=True)
def _solve(size, pivots, panel_start, dofs_start, dofs, panels, sides, work, routines, letters, numbers):
    """Solve in place for the rows of `sides` (n, 3N)."""
    count = sides.shape[0]
    sizes = np.zeros(5, np.int32)
    sizes[3] = count
    sizes[4] = 1
    size_at = sizes.ctypes.data
    letter = letters.ctypes.data
    one = numbers.ctypes.data
    lower, left, transposed, plain = letter, letter, letter + 2, letter + 3
    one_step = size_at + 16
    w = work.ctypes.data
    for back in range(2):
        for turn in range(len(size)):
            f = len(size) - 1 - turn if back else turn
            n = size[f]
            p = pivots[f]
            if p == 0:
                continue
            rows = dofs[dofs_start[f] : dofs_start[f + 1]]
            for k in range(count):
                for i in range(n if back else p):
                    work[k * n + i] = sides[k, rows[i]]
                if not back:
                    for i in range(p, n):
                        work[k * n + i] = 0.0
            sizes[0] = p
            sizes[1] = n
            sizes[2] = n - p
            A = panels[panel_start[f] :].ctypes.data
            if count <= 2:
                for k in range(count):
                    x = w + 4 * k * n
                    y = x + 4 * p
                    if not back:
                        call(routines[4], (lower, plain, plain, size_at, A, size_at + 4, x, one_step))
                    if n > p:
                        if back:
                            call(
                                routines[5],
                                (
                                    transposed,
                                    size_at + 8,
                                    size_at,
                                    one + 4,
                                    A + 4 * p,
                                    size_at + 4,
                                    y,
                                    one_step,
                                    one,
                                    x,
                                    one_step,
                                ),
                            )
                        else:
                            call(
                                routines[5],
                                (
                                    plain,
                                    size_at + 8,
                                    size_at,
                                    one + 4,
                                    A + 4 * p,
                                    size_at + 4,
                                    x,
                                    one_step,
                                    one,
                                    y,
                                    one_step,
                                ),
                            )
                    if back:
                        call(routines[4], (lower, transposed, plain, size_at, A, size_at + 4, x, one_step))
            else:
                y = w + 4 * p
                if not back:
                    call(
                        routines[1],
                        (
                            left,
                            lower,
                            plain,
                            plain,
                            size_at,
                            size_at + 12,
                            one,
                            A,
                            size_at + 4,
                            w,
                            size_at + 4,
                        ),
                    )
                if n > p:
                    if back:
                        call(
                            routines[3],
                            (
                                transposed,
                                plain,
                                size_at,
                                size_at + 12,
                                size_at + 8,
                                one + 4,
                                A + 4 * p,
                                size_at + 4,
                                y,
                                size_at + 4,
                                one,
                                w,
                                size_at + 4,
                            ),
                        )
                    else:
                        call(
                            routines[3],
                            (
                                plain,
                                plain,
                                size_at + 8,
                                size_at + 12,
                                size_at,
                                one + 4,
                                A + 4 * p,
                                size_at + 4,
                                w,
                                size_at + 4,
                                one,
                                y,
                                size_at + 4,
                            ),
                        )
                if back:
                    call(
                        routines[1],
                        (
                            left,
                            lower,
                            transposed,
                            plain,
                            size_at,
                            size_at + 12,
                            one,
                            A,
                            size_at + 4,
                            w,
                            size_at + 4,
                        ),
                    )
            for k in range(count):
                for i in range(p):
                    sides[k, rows[i]] = work[k * n + i]
                if not back:
                    for i in range(p, n):
                        sides[k, rows[i]] += work[k * n + i]
