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


@njit(cache=True, nogil=True)
def sample(x0, z0, x, z, values, squared, at_x, at_z):
    """Pressure (n, m) at deformed places at_x (n,) by at_z (m,), between the lattice's nodes.

    The values are pressures, or squares of them. The undeformed place of each is found by steps of a fixed
    point: the skin moves little sideways.
    """
    out = np.empty((len(at_x), len(at_z)))
    for a in range(len(at_x)):
        for b in range(len(at_z)):
            back_x = at_x[a]
            back_z = at_z[b]
            for _ in range(_ROUNDS):
                i, s = _cell(x0, back_x)
                j, t = _cell(z0, back_z)
                off_x = at_x[a] - _between(x, i, s, j, t)
                off_z = at_z[b] - _between(z, i, s, j, t)
                back_x += off_x
                back_z += off_z
                if abs(off_x) + abs(off_z) < 1e-9:
                    break
            i, s = _cell(x0, back_x)
            j, t = _cell(z0, back_z)
            value = _between(values, i, s, j, t)
            out[a, b] = np.sqrt(max(value, 0.0)) if squared else value
    return out
