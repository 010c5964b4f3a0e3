"""Compiled loops over the skin's lattice. Units: mm, kPa."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

from palpate.sim.tissue.border import squares

_ROUNDS = 12


@njit(cache=True, nogil=True, inline="always")
def _cell(lines, value):
    """Number of the interval that holds a value, and how far into it, from 0 to 1."""
    k = min(max(np.searchsorted(lines, value, side="right") - 1, 0), len(lines) - 2)
    return k, min(max((value - lines[k]) / (lines[k + 1] - lines[k]), 0.0), 1.0)


@njit(cache=True, nogil=True, inline="always")
def _between(field, i, s, j, t):
    low = (1 - t) * field[i, j] + t * field[i, j + 1]
    high = (1 - t) * field[i + 1, j] + t * field[i + 1, j + 1]
    return (1 - s) * low + s * high


@njit(cache=True, nogil=True)
def to_border(x, z, pressure, along, across):
    """Squares of the pressure, below 0 beyond the border of the contact.

    Along and across are `last_over_next` of the lattice's lines. A node that touches last both ways is put
    right by both. A node outside that no line joins to one inside lies off a corner.
    """
    n, m = pressure.shape
    factor = np.ones((n, m))
    beyond = np.zeros((n, m))
    seen = np.zeros((n, m))
    for i in range(n):
        for j in range(m):
            for way in range(4):
                d = 1 - 2 * (way % 2)
                di, dj = (d, 0) if way < 2 else (0, d)
                a, b = i + di, j + dj
                far_a, far_b = i + 2 * di, j + 2 * dj
                out_a, out_b = i - di, j - dj
                if not (0 <= out_a < n and 0 <= out_b < m and 0 <= far_a < n and 0 <= far_b < m):
                    continue
                if pressure[i, j] <= 0.0 or pressure[out_a, out_b] > 0.0 or pressure[a, b] <= 0.0:
                    continue
                last = pressure[i, j], pressure[a, b], pressure[far_a, far_b]
                if way < 2:
                    places = x[out_a, j], x[i, j], x[a, j], x[far_a, j]
                    ratios, next_ratios = along[way % 2, i], along[way % 2, a]
                else:
                    places = z[i, out_b], z[i, j], z[i, b], z[i, far_b]
                    ratios, next_ratios = across[way % 2, j], across[way % 2, b]
                ways = abs(places[1] - places[0]), abs(places[2] - places[1]), abs(places[3] - places[2])
                inner, own, outer = squares(last, ways, ratios, next_ratios)
                factor[a, b] *= inner / last[1] ** 2
                here = own / last[0] ** 2
                if min(factor[i, j], here) < 0.0:  # beyond the border one way: so it is, whatever the other
                    factor[i, j] = min(factor[i, j], here)
                else:
                    factor[i, j] *= here
                beyond[out_a, out_b] += outer
                seen[out_a, out_b] += 1.0
    square = np.where(seen > 0.0, beyond / np.maximum(seen, 1.0), pressure * pressure * factor)
    for i in range(n):
        for j in range(m):
            if pressure[i, j] > 0.0 or seen[i, j] > 0.0:
                continue
            corners = 0
            off = 0.0
            for a in (i - 1, i + 1):
                for b in (j - 1, j + 1):
                    if 0 <= a < n and 0 <= b < m and pressure[a, b] > 0.0:
                        off += square[i, b] + square[a, j] - square[a, b]
                        corners += 1
            if corners > 0:
                square[i, j] = min(off / corners, 0.0)
    return square


@njit(cache=True, nogil=True, inline="always")
def _mean_root(one, two, three):
    """Mean over a triangle of the root of what goes in a straight line from corner to corner, where above 0.

    Twice the second divided difference of 4/15 q^(5/2), whose second derivative is the root (Hermite and
    Genocchi); with roots of the corners nothing cancels.
    """
    a = max(one, two, three)
    c = min(one, two, three)
    b = one + two + three - a - c
    if a <= 0.0:
        return 0.0
    p = np.sqrt(a)
    if b <= 0.0:
        return 8.0 / 15.0 * p**5 / ((a - b) * (a - c))
    q = np.sqrt(b)
    if c <= 0.0:
        upper = (p**4 + p**3 * q + p * p * q * q + p * q**3 + q**4) / (p + q)
        return 8.0 / 15.0 * (upper - q**5 / (b - c)) / (a - c)
    r = np.sqrt(c)
    ends = p * p + p * r + r * r
    top = q**3 * (p + r) + q * q * (p + r) ** 2 + q * (p + r) * ends + p * r * ends
    return 8.0 / 15.0 * top / ((p + q) * (q + r) * (r + p))


@njit(cache=True, nogil=True)
def _square_at(x0, z0, x, z, square, at_x, at_z):
    """Square of the pressure at a deformed place. The undeformed one is found by steps of a fixed point: the
    skin moves little sideways."""
    back_x, back_z = at_x, at_z
    for _ in range(_ROUNDS):
        i, s = _cell(x0, back_x)
        j, t = _cell(z0, back_z)
        off_x = at_x - _between(x, i, s, j, t)
        off_z = at_z - _between(z, i, s, j, t)
        back_x += off_x
        back_z += off_z
        if abs(off_x) + abs(off_z) < 1e-9:
            break
    i, s = _cell(x0, back_x)
    j, t = _cell(z0, back_z)
    return _between(square, i, s, j, t)


@njit(cache=True, nogil=True)
def mean_pressures(x0, z0, x, z, square, at_x, at_z):
    """Mean pressure (n, m) of cells cut into parts at deformed places at_x (n, k) by at_z (m, k)."""
    n, m, k = len(at_x), len(at_z), at_x.shape[1]
    out = np.zeros((n, m))
    q = np.empty((k, k))
    for cell in range(n * m):
        a, b = cell // m, cell % m
        for i in range(k):
            for j in range(k):
                q[i, j] = _square_at(x0, z0, x, z, square, at_x[a, i], at_z[b, j])
        total = 0.0
        for i in range(k - 1):
            for j in range(k - 1):  # by both diagonals, so that an image has the symmetry of its skin
                one, two, three, four = q[i, j], q[i + 1, j], q[i + 1, j + 1], q[i, j + 1]
                total += _mean_root(one, two, three) + _mean_root(one, three, four)
                total += _mean_root(two, three, four) + _mean_root(one, two, four)
        out[a, b] = total / (4 * (k - 1) ** 2)
    return out
