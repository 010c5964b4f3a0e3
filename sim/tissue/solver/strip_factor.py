"""Compiled loops of `strip.py` that factor."""

# mypy: ignore-errors
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from palpate.sim.tissue.solver.lapack import Lapack, partial_cholesky
from palpate.sim.tissue.solver.strip_layout import Chain, Columns
from palpate.sim.tissue.solver.strip_tangent import Tangent


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
    one = M.dtype.type(1.0)
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
            s = one / np.sqrt(row[k])
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


class Factor(NamedTuple):
    """Where a chain's factor is kept.

    Attributes
    ----------
    work : ndarray (stride, stride)
        The square in which a step is eliminated.
    rows : ndarray (chain.row_starts[-1],)
        The rows one after the other, (inverse of the pivot, what it reaches), so that a solution reads memory
        in order.
    schur : ndarray (steps, front, front)
        The Schur complements of all steps, upper triangles.
    """

    work: np.ndarray
    rows: np.ndarray
    schur: np.ndarray


@njit(cache=True, nogil=True)
def eliminate(begin, end, flipped, tangent, columns, chain, factor, lapack):
    """Eliminate steps `begin` to `end` of a chain: A = U^T U, row by row. False if a pivot is not positive.

    `tangent`, `columns`, `chain`, `factor` (which is filled) and `lapack` are plain tuples of what `Tangent`,
    `Columns`, `Chain`, `Factor` and `Lapack` hold.
    """
    # As plain tuples they came in without numba's slow look at the types of named ones (a hundredth of the
    # stroke); the arrays are taken out once, since in a loop each would be counted again.
    chain = Chain(*chain)
    columns = Columns(*columns)
    tangent = Tangent(*tangent)
    factor = Factor(*factor)
    size = chain.size
    pivots = chain.pivots
    interior = chain.interior
    spans = chain.spans
    incoming = chain.incoming
    incoming_size = chain.incoming_size
    together = chain.together
    targets = chain.targets
    surface_place = chain.surface_place
    row_starts = chain.row_starts
    elements = columns.elements
    element_starts = columns.element_starts
    surface = columns.surface
    surface_starts = columns.surface_starts
    packed = tangent.packed
    contact = tangent.contact
    work = factor.work
    rows = factor.rows
    schur = factor.schur
    blas = Lapack(*lapack)
    sizes = np.zeros(4, np.int32)
    flat = work.ravel()
    one = rows.dtype.type(1.0)
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
        if not partial_cholesky(work, m, p - m, n, blas, sizes):
            return False
        place = row_starts[g]
        for i in range(p):
            source = work[i]
            first = n
            if i < m:
                first = spans[g, i // 4, 0]
            rows[place] = one / source[i]
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
def join(left, right, order, root, n, lapack):
    """Add both sides' Schur complements at the root and factor the sum."""
    for i in range(n):
        for j in range(i, n):
            root[i, j] = left[i, j]
    for i in range(n):
        for j in range(i, n):
            a = order[i]
            b = order[j]
            root[min(a, b), max(a, b)] += right[i, j]
    return partial_cholesky(root, 0, n, n, Lapack(*lapack), np.zeros(4, np.int32))
