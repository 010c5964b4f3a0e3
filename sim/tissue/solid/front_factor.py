"""Compiled loops of `multifrontal.py` that factor, front by front."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

from palpate.sim.tissue.solver.lapack import call


@njit(cache=True, nogil=True)
def spread(dirty, parent, kept):
    """What is over a changed front changes with it, and needs the rests of those below that are not kept."""
    for f in range(len(dirty)):
        if dirty[f] and parent[f] >= 0:
            dirty[parent[f]] = True
    for f in range(len(dirty) - 1, -1, -1):
        if not kept[f] and parent[f] >= 0 and dirty[parent[f]]:
            dirty[f] = True


@njit(cache=True, nogil=True)
def factor_fronts(
    first, last, dirty, kept, size, pivots, panel_start, corner_start, rest_start, child_start, child,
    element_start, element_rows, up_start, up, run_start, run, contact_start, contact, contact_rows, K,
    blocks, panels, corners, rests, routines, letters, numbers,
):  # fmt: skip
    """Renew the dirty ones of the fronts `first` to before `last`; their elements' stiffnesses stand in K one
    after the other; False if a pivot is not positive."""
    sizes = np.zeros(4, np.int32)
    next_element = 0
    for f in range(first, last):
        if not dirty[f]:
            continue
        p = pivots[f]
        n = size[f]
        m = n - p
        # a front in two parts: p pivot rows of length n, and the square of what remains
        panel = panels[panel_start[f] : panel_start[f + 1]]
        corner = corners[corner_start[f] : corner_start[f] + m * m]
        panel[:] = 0.0
        for i in range(m):
            corner[i * m + i : i * m + m] = 0.0
        for k in range(element_start[f], element_start[f + 1]):
            _add_block(panel, corner, p, n, K[next_element], element_rows[k])
            next_element += 1
        for k in range(contact_start[f], contact_start[f + 1]):
            _add_block(panel, corner, p, n, blocks[contact[k]], contact_rows[contact[k]])
        for k in range(child_start[f], child_start[f + 1]):
            c = child[k]
            below = size[c] - pivots[c]
            fresh = dirty[c]
            if fresh:
                rest = corners[corner_start[c] : corner_start[c] + below * below]
            else:
                rest = rests[rest_start[c] : rest_start[c + 1]]
            _extend(
                panel, corner, p, n, rest, not fresh, up[up_start[c] : up_start[c + 1]],
                run[run_start[c] : run_start[c + 1]],
            )  # fmt: skip
        if not _eliminate(panel, corner, p, n, routines, letters, numbers, sizes):
            return False
        if kept[f]:
            rest = rests[rest_start[f] : rest_start[f + 1]]
            for i in range(m):
                row = _packed(i, m)
                rest[row + i : row + m] = corner[i * m + i : i * m + m]
    return True


@njit(cache=True, nogil=True, inline="always")
def _packed(i, m):
    """Where row i of a packed upper triangle of order m would begin if its first i numbers were there."""
    return i * m - i * (i + 1) // 2


@njit(cache=True, nogil=True, inline="always")
def _add_block(panel, corner, p, n, block, rows):
    """Add the upper triangle of a block to a front's; rows below 0 are held."""
    for i in range(len(rows)):
        a = rows[i]
        if a >= 0:
            for j in range(i, len(rows)):
                b = rows[j]
                if b >= 0:
                    row = min(a, b)
                    column = max(a, b)
                    if row < p:
                        panel[row * n + column] += block[i, j]
                    else:
                        corner[(row - p) * (n - p) + column - p] += block[i, j]


@njit(cache=True, nogil=True)
def _extend(panel, corner, p, n, rest, packed, up, run):
    """Add a child's rest, an upper triangle, to its parent; its rows go up in runs of neighbours."""
    m = len(up)
    for r in range(len(run) - 1):
        for i in range(run[r], run[r + 1]):
            row = _packed(i, m) if packed else i * m
            if up[i] < p:
                target = panel[up[i] * n :]
                left = 0
            else:
                target = corner[(up[i] - p) * (n - p) :]
                left = p
            for s in range(r, len(run) - 1):
                first = max(run[s], i)
                to = target[up[run[s]] + first - run[s] - left :]
                come = rest[row + first : row + run[s + 1]]
                for j in range(len(come)):
                    to[j] += come[j]


@njit(cache=True, nogil=True)
def _eliminate(panel, corner, p, n, routines, letters, numbers, sizes):
    """The panel becomes rows of U; the corner, the Schur complement."""
    # Row-major upper is LAPACK's column-major lower, so nothing is copied.
    sizes[0] = p
    sizes[1] = n
    sizes[2] = n - p
    sizes[3] = 0
    if p == 0:
        return True
    base = panel.ctypes.data
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
        rest = corner.ctypes.data
        call(routines[2], (lower, plain, size + 8, size, one + 4, below, size + 4, one, rest, size + 8))
    return True
