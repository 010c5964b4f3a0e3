"""Compiled loops of `strip.py` that solve with a factor."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

_OUTER = np.array([0, 1, 2, 3, 5, 6, 7, 8, 9, 10, 11, 12, 14, 15, 16, 17])


@njit(cache=True, nogil=True)
def forward_elements(x, outer, middle, condensed):
    """Carry the middles' right-hand sides over to their elements' other nodes."""
    for r in range(x.shape[0]):
        b = x[r]
        for e in range(outer.shape[0]):
            u = b[middle[e]]
            v = b[middle[e] + 1]
            if u == 0.0 and v == 0.0:
                continue
            for k in range(16):
                c = _OUTER[k]
                b[outer[e, k]] -= condensed[e, 0, c] * u + condensed[e, 1, c] * v


@njit(cache=True, nogil=True)
def backward_elements(x, outer, middle, condensed):
    """Solve for the middles once the rest is known."""
    for r in range(x.shape[0]):
        b = x[r]
        for e in range(outer.shape[0]):
            p = b[middle[e]]
            q = b[middle[e] + 1]
            u = condensed[e, 0, 4] * p + condensed[e, 0, 13] * q
            v = condensed[e, 1, 4] * p + condensed[e, 1, 13] * q
            for k in range(16):
                c = _OUTER[k]
                value = b[outer[e, k]]
                u -= condensed[e, 0, c] * value
                v -= condensed[e, 1, c] * value
            b[middle[e]] = u
            b[middle[e] + 1] = v


@njit(cache=True, nogil=True, inline="always")
def _reach_of_row(k, n, interior, spans):
    """End of row k's first range, which begins at k, and begin and end of its second."""
    if k < interior:
        return spans[k // 4, 0], spans[k // 4, 1], spans[k // 4, 2]
    return n, 0, 0


@njit(cache=True, nogil=True)
def forward(x, count, dofs, interior, pivots, size, spans, row_starts, rows):
    """Forward substitution along `count` steps of a chain, for right-hand sides x (k, 2N)."""
    local = np.empty(dofs.shape[1], x.dtype)
    for g in range(count):
        n = size[g]
        for r in range(x.shape[0]):
            some = False
            for i in range(n):
                local[i] = x[r, dofs[g, i]]
                some |= local[i] != 0.0
            if not some:  # the border's, before the contact
                continue
            p = row_starts[g]
            for k in range(pivots[g]):
                inner, begin, end = _reach_of_row(k, n, interior[g], spans[g])
                row = rows[p : p + inner - k]
                near = local[k:inner]
                v = near[0] * row[0]
                near[0] = v
                for j in range(1, len(row)):
                    near[j] -= v * row[j]
                p += inner - k
                row = rows[p : p + end - begin]
                near = local[begin:end]
                for j in range(len(row)):
                    near[j] -= v * row[j]
                p += end - begin
            for i in range(n):
                x[r, dofs[g, i]] = local[i]


@njit(cache=True, fastmath=True, nogil=True)
def backward(x, count, dofs, interior, pivots, size, spans, row_starts, rows):
    """Back substitution along `count` steps of a chain, the last first.

    Its sums are taken in any order, so in lanes; two right-hand sides share each read of the rows.
    """
    a = np.zeros(dofs.shape[1], x.dtype)
    b = np.zeros(dofs.shape[1], x.dtype)
    last = x.shape[0] - 1
    for g in range(count - 1, -1, -1):
        n = size[g]
        for i in range(n):
            a[i] = x[0, dofs[g, i]]
            b[i] = x[last, dofs[g, i]]
        p = row_starts[g + 1]
        for k in range(pivots[g] - 1, -1, -1):
            inner, begin, end = _reach_of_row(k, n, interior[g], spans[g])
            p -= inner - k + end - begin
            row = rows[p : p + inner - k]
            near = a[k:inner]
            next_near = b[k:inner]
            v = near[0]
            w = next_near[0]
            for j in range(1, len(row)):
                v -= row[j] * near[j]
                w -= row[j] * next_near[j]
            row = rows[p + inner - k : p + inner - k + end - begin]
            near = a[begin:end]
            next_near = b[begin:end]
            for j in range(len(row)):
                v -= row[j] * near[j]
                w -= row[j] * next_near[j]
            a[k] = v * rows[p]
            b[k] = w * rows[p]
        for i in range(pivots[g]):
            x[0, dofs[g, i]] = a[i]
            x[last, dofs[g, i]] = b[i]


@njit(cache=True, nogil=True)
def solve_root(x, dofs, U):
    """Both substitutions at the root."""
    n = len(dofs)
    local = np.empty(n, x.dtype)
    for r in range(x.shape[0]):
        for i in range(n):
            local[i] = x[r, dofs[i]]
        for k in range(n):
            v = local[k] / U[k, k]
            local[k] = v
            for j in range(k + 1, n):
                local[j] -= v * U[k, j]
        for k in range(n - 1, -1, -1):
            v = local[k]
            for j in range(k + 1, n):
                v -= U[k, j] * local[j]
            local[k] = v / U[k, k]
        for i in range(n):
            x[r, dofs[i]] = local[i]
