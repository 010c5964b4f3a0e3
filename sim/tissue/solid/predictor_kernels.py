"""Compiled loops of `predictor.py`: the lattice moved with the probe."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def add_nodes(out, known, weight, u, distance, nodes, x):
    """Add to `out` (a, b, c, 3) `weight` times displacements moved right by `distance`.

    `nodes` (a, b, c) is the lattice, whose first lines stand at x (a,); what comes from inside the box is not
    known.
    """
    last = len(x) - 1
    for i in range(out.shape[0]):
        wanted = min(max(x[i] - distance, x[0]), x[last])
        source = min(max(np.searchsorted(x, wanted + 1e-9, side="right") - 1, 0), last - 1)
        share = min(max((wanted - x[source]) / (x[source + 1] - x[source]), 0.0), 1.0)
        if share < 1e-9:
            share = 0.0
        for j in range(out.shape[1]):
            for k in range(out.shape[2]):
                n = nodes[source, j, k]
                m = nodes[source + 1, j, k] if share > 0.0 else n
                if n < 0 or m < 0:
                    known[i, j, k] = False
                    continue
                for d in range(3):
                    out[i, j, k, d] += weight * ((1.0 - share) * u[3 * n + d] + share * u[3 * m + d])


@njit(cache=True, nogil=True)
def add_cells(out, known, weight, pressure, distance, elements, centre, root_volume):
    """Add to `out` (a, b, c, 4) `weight` times pressure coefficients (M, 4) moved right by `distance`.

    Each element takes what the one under its moved centre has, scaled to its own size.
    """
    last = len(centre) - 1
    for i in range(out.shape[0]):
        wanted = centre[i] - distance
        source = 0
        while source < last and (centre[source + 1] + centre[source]) / 2 < wanted:
            source += 1
        for j in range(out.shape[1]):
            for k in range(out.shape[2]):
                e = elements[i, j, k]
                s = elements[source, j, k]
                if e < 0 or s < 0:
                    known[i, j, k] = False
                    continue
                size = weight * root_volume[e] / root_volume[s]
                for d in range(4):
                    out[i, j, k, d] += size * pressure[s, d]


@njit(cache=True, nogil=True)
def shifted(values, distance, x):
    """Values (a, c) on lines at x (a,) moved right by `distance`; 0 comes from outside."""
    out = np.zeros_like(values)
    last = len(x) - 1
    for i in range(len(x)):
        wanted = x[i] - distance
        if wanted < x[0] or wanted > x[last]:
            continue
        source = min(max(np.searchsorted(x, wanted, side="right") - 1, 0), last - 1)
        share = (wanted - x[source]) / (x[source + 1] - x[source])
        for k in range(values.shape[1]):
            out[i, k] = (1.0 - share) * values[source, k] + share * values[source + 1, k]
    return out


@njit(cache=True, nogil=True)
def blend(values, moved, lattice, share):
    """Move values (n, d) towards `moved` (a, b, c, d) on a lattice (a, b, c) by `share`."""
    for i in range(lattice.shape[0]):
        for j in range(lattice.shape[1]):
            for k in range(lattice.shape[2]):
                n = lattice[i, j, k]
                s = share[i, j, k]
                if n >= 0 and s > 0.0:
                    for d in range(values.shape[1]):
                        values[n, d] += s * (moved[i, j, k, d] - values[n, d])
