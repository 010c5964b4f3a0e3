"""Compiled loops of `strip.py`."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

from sim.tissue.lapack import partial_cholesky


@njit(cache=True, nogil=True)
def reach(interior, size, elements, starts, place, flipped):
    """Symbolic elimination of every step's interior: how far the rows of four at a time reach.

    Returns (steps, chunks, 3): end of the interior range; begin and end of the range among the others.
    """
    steps = len(size)
    chunks = (max(1, interior.max()) + 3) // 4
    spans = np.zeros((steps, chunks, 3), np.int64)
    for g in range(steps):
        c = steps - 1 - g if flipped else g
        m = interior[g]
        n = size[g]
        full = np.zeros((m, n), np.bool_)
        for e in elements[starts[c] : starts[c + 1]]:
            for a in range(16):
                i = place[e, a]
                if 0 <= i < m:
                    for b in range(16):
                        if place[e, b] >= 0:
                            full[i, place[e, b]] = True
        for k in range(m):
            for i in range(k + 1, m):
                if full[k, i]:
                    for j in range(k + 1, n):
                        full[i, j] |= full[k, j]
        for chunk in range((m + 3) // 4):
            last = min(4 * chunk + 4, m)
            inner = last
            begin = n
            end = m
            for k in range(4 * chunk, last):
                for j in range(k, m):
                    if full[k, j]:
                        inner = max(inner, j + 1)
                for j in range(m, n):
                    if full[k, j]:
                        begin = min(begin, j)
                        end = max(end, j + 1)
            spans[g, chunk, 0] = inner
            spans[g, chunk, 1] = min(begin, end)
            spans[g, chunk, 2] = end
    return spans


@njit(cache=True, nogil=True)
def condense_elements(K, which, condensed, packed):
    """Eliminate the middle node of elements `which`; the rest's upper triangle goes to `packed` (M, 136)."""
    for e in which:
        k = K[e]
        # Places of the middle node in the element's 18 are 4 (x) and 13 (y).
        a = k[4, 4]
        b = k[4, 13]
        d = k[13, 13]
        det = a * d - b * b
        if not (det > 0.0 and a > 0.0):
            return False
        ia = d / det
        ib = -b / det
        ic = a / det
        u = condensed[e, 0]
        v = condensed[e, 1]
        for c in range(18):
            u[c] = ia * k[4, c] + ib * k[13, c]
            v[c] = ib * k[4, c] + ic * k[13, c]
        m = 0
        for r in range(18):
            if r == 4 or r == 13:
                continue
            x = k[4, r]
            y = k[13, r]
            if r < 4:
                for c in range(r, 4):
                    packed[e, m] = k[r, c] - x * u[c] - y * v[c]
                    m += 1
            for c in range(max(r, 5), 13):
                packed[e, m] = k[r, c] - x * u[c] - y * v[c]
                m += 1
            for c in range(max(r, 14), 18):
                packed[e, m] = k[r, c] - x * u[c] - y * v[c]
                m += 1
        u[4] = ia
        u[13] = ib
        v[4] = ib
        v[13] = ic
    return True


@njit(cache=True, nogil=True, inline="always")
def _subtract_four(M, k, begin, end, stop):
    """Take rows k to k + 3, times themselves, off rows `begin` to `end`, up to column `stop`."""
    p = M[k]
    q = M[k + 1]
    r = M[k + 2]
    s = M[k + 3]
    i = begin
    while i + 1 < end:
        a0 = p[i]
        a1 = q[i]
        a2 = r[i]
        a3 = s[i]
        b0 = p[i + 1]
        b1 = q[i + 1]
        b2 = r[i + 1]
        b3 = s[i + 1]
        upper = M[i]
        lower = M[i + 1]
        for j in range(i, stop):
            w = p[j]
            x = q[j]
            y = r[j]
            z = s[j]
            upper[j] -= a0 * w + a1 * x + a2 * y + a3 * z
            lower[j] -= b0 * w + b1 * x + b2 * y + b3 * z
        i += 2
    if i < end:
        a0 = p[i]
        a1 = q[i]
        a2 = r[i]
        a3 = s[i]
        upper = M[i]
        for j in range(i, stop):
            upper[j] -= a0 * p[j] + a1 * q[j] + a2 * r[j] + a3 * s[j]


@njit(cache=True, nogil=True)
def _eliminate_interior(M, interior, spans):
    """Eliminate the first rows of M, four at a time, each only as far as it reaches."""
    for chunk in range((interior + 3) // 4):
        k0 = 4 * chunk
        k1 = min(k0 + 4, interior)
        inner = spans[chunk, 0]
        begin = spans[chunk, 1]
        end = spans[chunk, 2]
        for k in range(k0, k1):
            row = M[k]
            if not row[k] > 0.0:
                return False
            s = 1.0 / np.sqrt(row[k])
            for j in range(k, inner):
                row[j] *= s
            for j in range(begin, end):
                row[j] *= s
            for i in range(k + 1, k1):
                c = row[i]
                target = M[i]
                for j in range(i, inner):
                    target[j] -= c * row[j]
                for j in range(begin, end):
                    target[j] -= c * row[j]
        if k1 - k0 == 4:
            p = M[k0]
            q = M[k0 + 1]
            r = M[k0 + 2]
            s4 = M[k0 + 3]
            for i in range(k1, inner):
                a = p[i]
                b = q[i]
                c = r[i]
                d = s4[i]
                target = M[i]
                for j in range(i, inner):
                    target[j] -= a * p[j] + b * q[j] + c * r[j] + d * s4[j]
                for j in range(begin, end):
                    target[j] -= a * p[j] + b * q[j] + c * r[j] + d * s4[j]
            _subtract_four(M, k0, begin, end, end)
        else:
            for k in range(k0, k1):
                row = M[k]
                for i in range(begin, end):
                    c = row[i]
                    target = M[i]
                    for j in range(i, end):
                        target[j] -= c * row[j]
    return True


@njit(cache=True, nogil=True)
def eliminate(
    begin, end, flipped, packed, contact, elements, element_starts, surface, surface_starts, work, interior,
    pivots, size, incoming, incoming_size, together, spans, targets, surface_place, row_starts, rows, schur,
    routines, letters, factors,
):  # fmt: skip
    """Eliminate steps `begin` to `end` of a chain.

    Rows are kept one after the other in `rows`, (inverse of the pivot, what it reaches), so that a solution
    reads memory in order; Schur complements are kept in `schur`.
    """
    sizes = np.zeros(4, np.int32)
    flat = work.ravel()
    steps = len(size)
    for g in range(begin, end):
        n = size[g]
        p = pivots[g]
        m = interior[g]
        for i in range(n):
            row = work[i]
            for j in range(i, n):
                row[j] = 0.0
        if g > 0:
            before = schur[g - 1]
            count = incoming_size[g]
            for i in range(count):
                source = before[i]
                a = incoming[g, i]
                if together[g]:
                    row = work[a]
                    for j in range(i, count):
                        row[a + j - i] = source[j]
                else:
                    for j in range(i, count):
                        b = incoming[g, j]
                        work[min(a, b), max(a, b)] = source[j]
        c = steps - 1 - g if flipped else g
        for index in range(element_starts[c], element_starts[c + 1]):
            e = elements[index]
            target = targets[e]
            source = packed[e]
            for k in range(136):
                flat[target[k]] += source[k]
        for index in range(surface_starts[c], surface_starts[c + 1]):
            s = surface[index]
            i = surface_place[s, 0]
            j = surface_place[s, 1]
            if i >= 0:
                work[i, i] += contact[s, 0]
                work[min(i, j), max(i, j)] += contact[s, 1]
            work[j, j] += contact[s, 2]
        if not _eliminate_interior(work, m, spans[g]):
            return False
        if not partial_cholesky(work, m, p - m, n, routines, letters, factors, sizes):
            return False
        place = row_starts[g]
        for i in range(p):
            source = work[i]
            first = n
            if i < m:
                first = spans[g, i // 4, 0]
            rows[place] = 1.0 / source[i]
            for j in range(i + 1, first):
                rows[place + j - i] = source[j]
            place += first - i
            if i < m:
                begin_other = spans[g, i // 4, 1]
                count_other = spans[g, i // 4, 2] - begin_other
                for j in range(count_other):
                    rows[place + j] = source[begin_other + j]
                place += count_other
        rest = schur[g]
        for i in range(n - p):
            source = work[p + i]
            row = rest[i]
            for j in range(i, n - p):
                row[j] = source[j + p]
    return True


@njit(cache=True, nogil=True)
def join(left, right, order, root, n, routines, letters, factors):
    """Add both sides' Schur complements at the root and factor the sum."""
    for i in range(n):
        for j in range(i, n):
            root[i, j] = left[i, j]
    for i in range(n):
        for j in range(i, n):
            a = order[i]
            b = order[j]
            root[min(a, b), max(a, b)] += right[i, j]
    return partial_cholesky(root, 0, n, n, routines, letters, factors, np.zeros(4, np.int32))


_OUTER = np.array([0, 1, 2, 3, 5, 6, 7, 8, 9, 10, 11, 12, 14, 15, 16, 17])


@njit(cache=True, nogil=True)
def forward_elements(x, outer, middle, condensed):
    """Carry the middles' right-hand sides over to their elements' other nodes."""
    for r in range(x.shape[0]):
        b = x[r]
        for e in range(outer.shape[0]):
            u = b[middle[e]]
            v = b[middle[e] + 1]
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


@njit(cache=True, nogil=True)
def forward(x, count, dofs, interior, pivots, size, spans, row_starts, rows):
    """Forward substitution along `count` steps of a chain, for right-hand sides x (k, 2N)."""
    local = np.empty((x.shape[0], dofs.shape[1]))
    for g in range(count):
        n = size[g]
        for r in range(x.shape[0]):
            for i in range(n):
                local[r, i] = x[r, dofs[g, i]]
        p = row_starts[g]
        for k in range(pivots[g]):
            inner = n
            begin = 0
            others = 0
            if k < interior[g]:
                inner = spans[g, k // 4, 0]
                begin = spans[g, k // 4, 1]
                others = spans[g, k // 4, 2] - begin
            row = rows[p : p + inner - k]
            far = rows[p + inner - k : p + inner - k + others]
            p += inner - k + others
            for r in range(x.shape[0]):
                near = local[r, k:inner]
                v = near[0] * row[0]
                near[0] = v
                for j in range(1, len(row)):
                    near[j] -= v * row[j]
                if others > 0:
                    away = local[r, begin : begin + others]
                    for j in range(others):
                        away[j] -= v * far[j]
        for r in range(x.shape[0]):
            for i in range(n):
                x[r, dofs[g, i]] = local[r, i]


@njit(cache=True, nogil=True)
def backward(x, count, dofs, interior, pivots, size, spans, row_starts, rows):
    """Back substitution along `count` steps of a chain, the last first."""
    local = np.empty((x.shape[0], dofs.shape[1]))
    for g in range(count - 1, -1, -1):
        n = size[g]
        for r in range(x.shape[0]):
            for i in range(n):
                local[r, i] = x[r, dofs[g, i]]
        p = row_starts[g + 1]
        for k in range(pivots[g] - 1, -1, -1):
            inner = n
            begin = 0
            others = 0
            if k < interior[g]:
                inner = spans[g, k // 4, 0]
                begin = spans[g, k // 4, 1]
                others = spans[g, k // 4, 2] - begin
            p -= inner - k + others
            row = rows[p : p + inner - k]
            far = rows[p + inner - k : p + inner - k + others]
            for r in range(x.shape[0]):
                near = local[r, k:inner]
                v = near[0]
                for j in range(1, len(row)):
                    v -= row[j] * near[j]
                if others > 0:
                    away = local[r, begin : begin + others]
                    for j in range(others):
                        v -= far[j] * away[j]
                near[0] = v * row[0]
        for r in range(x.shape[0]):
            for i in range(pivots[g]):
                x[r, dofs[g, i]] = local[r, i]


@njit(cache=True, nogil=True)
def solve_root(x, dofs, U):
    """Both substitutions at the root."""
    n = len(dofs)
    local = np.empty(n)
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


@njit(cache=True, nogil=True)
def row_lengths(interior, pivots, size, spans):
    """How many numbers every step keeps."""
    out = np.zeros(len(size), np.int64)
    for g in range(len(size)):
        for k in range(pivots[g]):
            if k < interior[g]:
                span = spans[g, k // 4]
                out[g] += span[0] - k + span[2] - span[1]
            else:
                out[g] += size[g] - k
    return out
