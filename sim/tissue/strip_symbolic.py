"""Compiled loops of `strip_layout.py`: what reaches where."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit


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


@njit(cache=True, nogil=True)
def targets(place, stride):
    """Where in a flat square of side `stride` the upper triangles (M, 136) of elements go.

    `place` (M, 16) holds the row of each of their unknowns, below 0 where it is held; the square's last
    number takes what is not wanted.
    """
    out = np.empty((place.shape[0], 136), np.int32)
    for e in range(place.shape[0]):
        k = 0
        for i in range(16):
            for j in range(i, 16):
                a = place[e, i]
                b = place[e, j]
                if a < 0 or b < 0:
                    out[e, k] = stride * stride - 1
                else:
                    out[e, k] = min(a, b) * stride + max(a, b)
                k += 1
    return out
