"""Compiled loop of `multifrontal.py` that solves, front by front."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

from palpate.sim.tissue.solver.lapack import call


@njit(cache=True, nogil=True)
def substitute(
    back, which, size, pivots, panel_start, dofs_start, dofs, panels, row, sides, work, routines, letters,
    numbers,
):  # fmt: skip
    """Put `sides` through U^T, forwards, or through U, back; in place, and only the fronts `which`.

    Unknown k stands in row row[k] of `sides` (rows, n), one column for each right-hand side.
    """
    count = sides.shape[1]
    sizes = np.zeros(5, np.int32)
    sizes[3] = count
    sizes[4] = 1
    # signed like the sums: where a name is now an address, now a sum, numba would make a float of it
    pivot_at = np.intp(sizes.ctypes.data)
    size_at = pivot_at + 4
    rest_at = pivot_at + 8
    count_at = pivot_at + 12
    step_at = pivot_at + 16
    letter = np.intp(letters.ctypes.data)
    one = numbers.ctypes.data
    minus_one = one + 4
    lower, right, transposed, plain = letter, letter + 1, letter + 2, letter + 3
    way = transposed if back else plain
    other_way = plain if back else transposed
    top = np.intp(work.ctypes.data)  # the rows that a front eliminates, and below them the others
    few = count <= 2
    for turn in range(len(which)):
        f = which[len(which) - 1 - turn] if back else which[turn]
        n = size[f]
        p = pivots[f]
        if p == 0:
            continue
        rows = dofs[dofs_start[f] : dofs_start[f + 1]]
        # few sides: one after the other, each a vector; many: side by side
        for i in range(n if back else p):
            for k in range(count):
                work[k * n + i if few else i * count + k] = sides[row[rows[i]], k]
        if not back:
            for i in range(p, n):
                for k in range(count):
                    work[k * n + i if few else i * count + k] = 0.0
        sizes[0] = p
        sizes[1] = n
        sizes[2] = n - p
        A = panels[panel_start[f] :].ctypes.data
        below = A + 4 * p
        # forwards the eliminated rows change the others; back, the others them
        if few:
            for k in range(count):
                first = top + 4 * k * n
                second = first + 4 * p
                source = second if back else first
                target = first if back else second
                if not back:
                    call(routines[4], (lower, way, plain, pivot_at, A, size_at, first, step_at))
                if n > p:
                    call(
                        routines[5],
                        (way, rest_at, pivot_at, minus_one, below, size_at, source, step_at, one, target,
                         step_at),
                    )  # fmt: skip
                if back:
                    call(routines[4], (lower, way, plain, pivot_at, A, size_at, first, step_at))
        else:
            second = top + 4 * p * count
            source = second if back else top
            target = top if back else second
            source_at = rest_at if back else pivot_at
            target_at = pivot_at if back else rest_at
            whole = (right, lower, other_way, plain, count_at, pivot_at, one, A, size_at, top, count_at)
            if not back:
                call(routines[1], whole)
            if n > p:
                call(
                    routines[3],
                    (plain, other_way, count_at, target_at, source_at, minus_one, source, count_at, below,
                     size_at, one, target, count_at),
                )  # fmt: skip
            if back:
                call(routines[1], whole)
        for i in range(p):
            for k in range(count):
                sides[row[rows[i]], k] = work[k * n + i if few else i * count + k]
        if not back:
            for i in range(p, n):
                for k in range(count):
                    sides[row[rows[i]], k] += work[k * n + i if few else i * count + k]
