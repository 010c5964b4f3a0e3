"""Compiled loops of `strip.py` that solve for many right-hand sides at once.

As in `strip_solve.py`, but the right-hand sides lie side by side, x (2N, k): every number of the factor is
read once for all of them, and the innermost loop runs over them.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

from palpate.sim.tissue.solver.strip_solve import _OUTER, _reach_of_row


@njit(cache=True, nogil=True)
def forward_elements(x, outer, middle, condensed):
    """Carry the middles' right-hand sides over to their elements' other nodes."""
    for e in range(outer.shape[0]):
        u = x[middle[e]]
        v = x[middle[e] + 1]
        for k in range(16):
            c = _OUTER[k]
            f = condensed[e, 0, c]
            g = condensed[e, 1, c]
            row = x[outer[e, k]]
            for r in range(x.shape[1]):
                row[r] -= f * u[r] + g * v[r]


@njit(cache=True, nogil=True)
def backward_elements(x, outer, middle, condensed):
    """Solve for the middles once the rest is known."""
    count = x.shape[1]
    u = np.empty(count, x.dtype)
    v = np.empty(count, x.dtype)
    for e in range(outer.shape[0]):
        p = x[middle[e]]
        q = x[middle[e] + 1]
        f = condensed[e, 0, 4], condensed[e, 0, 13], condensed[e, 1, 4], condensed[e, 1, 13]
        for r in range(count):
            u[r] = f[0] * p[r] + f[1] * q[r]
            v[r] = f[2] * p[r] + f[3] * q[r]
        for k in range(16):
            c = _OUTER[k]
            row = x[outer[e, k]]
            for r in range(count):
                u[r] -= condensed[e, 0, c] * row[r]
                v[r] -= condensed[e, 1, c] * row[r]
        p[:] = u
        q[:] = v


@njit(cache=True, nogil=True)
def forward(x, count, dofs, interior, pivots, size, spans, row_starts, rows):
    """Forward substitution along `count` steps of a chain."""
    many = x.shape[1]
    local = np.empty((dofs.shape[1], many), x.dtype)
    for g in range(count):
        n = size[g]
        for i in range(n):
            local[i] = x[dofs[g, i]]
        p = row_starts[g]
        for k in range(pivots[g]):
            inner, begin, end = _reach_of_row(k, n, interior[g], spans[g])
            here = local[k]
            for r in range(many):
                here[r] *= rows[p]
            for j in range(k + 1, inner):
                f = rows[p + j - k]
                there = local[j]
                for r in range(many):
                    there[r] -= f * here[r]
            p += inner - k
            for j in range(begin, end):
                f = rows[p + j - begin]
                there = local[j]
                for r in range(many):
                    there[r] -= f * here[r]
            p += end - begin
        for i in range(n):
            x[dofs[g, i]] = local[i]


@njit(cache=True, nogil=True)
def backward(x, count, dofs, interior, pivots, size, spans, row_starts, rows):
    """Back substitution along `count` steps of a chain, the last first."""
    many = x.shape[1]
    local = np.empty((dofs.shape[1], many), x.dtype)
    for g in range(count - 1, -1, -1):
        n = size[g]
        for i in range(n):
            local[i] = x[dofs[g, i]]
        p = row_starts[g + 1]
        for k in range(pivots[g] - 1, -1, -1):
            inner, begin, end = _reach_of_row(k, n, interior[g], spans[g])
            p -= inner - k + end - begin
            here = local[k]
            for j in range(k + 1, inner):
                f = rows[p + j - k]
                there = local[j]
                for r in range(many):
                    here[r] -= f * there[r]
            q = p + inner - k
            for j in range(begin, end):
                f = rows[q + j - begin]
                there = local[j]
                for r in range(many):
                    here[r] -= f * there[r]
            for r in range(many):
                here[r] *= rows[p]
        for i in range(pivots[g]):
            x[dofs[g, i]] = local[i]


@njit(cache=True, nogil=True)
def solve_root(x, dofs, U):
    """Both substitutions at the root."""
    n = len(dofs)
    many = x.shape[1]
    local = np.empty((n, many), x.dtype)
    for i in range(n):
        local[i] = x[dofs[i]]
    for k in range(n):
        here = local[k]
        for r in range(many):
            here[r] /= U[k, k]
        for j in range(k + 1, n):
            f = U[k, j]
            there = local[j]
            for r in range(many):
                there[r] -= f * here[r]
    for k in range(n - 1, -1, -1):
        here = local[k]
        for j in range(k + 1, n):
            f = U[k, j]
            there = local[j]
            for r in range(many):
                here[r] -= f * there[r]
        for r in range(many):
            here[r] /= U[k, k]
    for i in range(n):
        x[dofs[i]] = local[i]
