"""Compiled loops over the skin's lattice. Units: mm, kPa."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

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
def sample(x0, z0, x, z, pressure, at_x, at_z):
    """Pressure (n, m) at deformed places at_x (n,) by at_z (m,), between the lattice's nodes.

    The undeformed place of each is found by steps of a fixed point: the skin moves little sideways.
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
            out[a, b] = _between(pressure, i, s, j, t)
    return out
