"""Compiled loop of `multifrontal.py` that solves, front by front."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

from palpate.sim.tissue.solver.lapack import call


@njit(cache=True, nogil=True)
def solve_fronts(
    size, pivots, panel_start, dofs_start, dofs, panels, sides, work, routines, letters, numbers
):
    """Solve in place for the rows of `sides` (n, 3N): forwards with U^T, then back with U."""
    count = sides.shape[0]
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
    lower = letter
    left = letter
    transposed = letter + 2
    plain = letter + 3
    busy = np.empty(count, np.bool_)
    top = np.intp(work.ctypes.data)  # the rows that a front eliminates, and below them the others
    for back in range(2):
        way = transposed if back else plain
        for turn in range(len(size)):
            f = len(size) - 1 - turn if back else turn
            n = size[f]
            p = pivots[f]
            if p == 0:
                continue
            rows = dofs[dofs_start[f] : dofs_start[f + 1]]
            for k in range(count):
                some = back > 0
                for i in range(n if back else p):
                    work[k * n + i] = sides[k, rows[i]]
                    some |= sides[k, rows[i]] != 0.0
                busy[k] = some
                if not back:
                    for i in range(p, n):
                        work[k * n + i] = 0.0
            if not busy.any():  # a unit force is felt only on its way up
                continue
            sizes[0] = p
            sizes[1] = n
            sizes[2] = n - p
            A = panels[panel_start[f] :].ctypes.data
            below = A + 4 * p
            # forwards the eliminated rows change the others; back, the others them
            source_at = rest_at if back else pivot_at
            target_at = pivot_at if back else rest_at
            if count <= 2:
                for k in range(count):
                    if not busy[k]:
                        continue
                    first = top + 4 * k * n
                    second = first + 4 * p
                    source = second if back else first
                    target = first if back else second
                    if not back:
                        call(routines[4], (lower, way, plain, pivot_at, A, size_at, first, step_at))
                    if n > p:
                        call(
                            routines[5],
                            (way, rest_at, pivot_at, minus_one, below, size_at, source, step_at, one,
                             target, step_at),
                        )  # fmt: skip
                    if back:
                        call(routines[4], (lower, way, plain, pivot_at, A, size_at, first, step_at))
            else:
                second = top + 4 * p
                source = second if back else top
                target = top if back else second
                whole = (left, lower, way, plain, pivot_at, count_at, one, A, size_at, top, size_at)
                if not back:
                    call(routines[1], whole)
                if n > p:
                    call(
                        routines[3],
                        (way, plain, target_at, count_at, source_at, minus_one, below, size_at, source,
                         size_at, one, target, size_at),
                    )  # fmt: skip
                if back:
                    call(routines[1], whole)
            for k in range(count):
                for i in range(p):
                    sides[k, rows[i]] = work[k * n + i]
                if not back:
                    for i in range(p, n):
                        sides[k, rows[i]] += work[k * n + i]
