"""Compiled loops of `multifrontal.py` that factor, front by front."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

from palpate.sim.tissue.solver.lapack import call


@njit(cache=True, nogil=True)
def spread(dirty, parent):
    """What is over a changed front changes with it."""
    for f in range(len(dirty)):
        if dirty[f] and parent[f] >= 0:
            dirty[parent[f]] = True


@njit(cache=True, nogil=True)
def factor_fronts(
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
