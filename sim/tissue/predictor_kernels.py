"""Compiled loops of `predictor.py`: rows of the mesh moved with the probe."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def add_rows(out, weight, u, distance, nodes, x, first):
    """Add to `out` (R, C, 2) `weight` times displacements moved right by `distance`.

    Columns begin at `first` of the rows' `nodes` (R, S), which stand at `x` (S,).
    """
    last = len(x) - 1
    for c in range(out.shape[1]):
        wanted = min(max(x[first + c] - distance, x[0]), x[last])
        source = min(max(np.searchsorted(x, wanted, side="right") - 1, 0), last - 1)
        share = (wanted - x[source]) / (x[source + 1] - x[source])
        rest = 1 - share
        for r in range(out.shape[0]):
            n = 2 * nodes[r, source]
            m = 2 * nodes[r, source + 1]
            out[r, c, 0] += weight * (u[n] * rest + u[m] * share)
            out[r, c, 1] += weight * (u[n + 1] * rest + u[m + 1] * share)


@njit(cache=True, nogil=True)
def add_cells(out, weight, pressure, distance, elements, centre, root_area, first):
    """Add to `out` (Q, C, 3) `weight` times pressure coefficients (M, 3) moved right by `distance`.

    Each column takes what the column under its moved centre has, scaled to its own elements' size.
    """
    count = len(centre)
    for c in range(out.shape[1]):
        wanted = centre[first + c] - distance
        source = 0
        while source < count - 1 and (centre[source + 1] + centre[source]) / 2 < wanted:
            source += 1
        for r in range(out.shape[0]):
            size = root_area[r, first + c] / root_area[r, source]
            for k in range(3):
                out[r, c, k] += weight * (pressure[elements[r, source], k] * size)


@njit(cache=True, nogil=True)
def blend_rows(u, rows, nodes, row_share, column_share, first):
    """Move displacements u (2N,) towards `rows` (R, C, 2): u += row_share column_share (rows - u)."""
    for r in range(rows.shape[0]):
        for c in range(rows.shape[1]):
            share = row_share[r] * column_share[c]
            n = 2 * nodes[r, first + c]
            u[n] += share * (rows[r, c, 0] - u[n])
            u[n + 1] += share * (rows[r, c, 1] - u[n + 1])


@njit(cache=True, nogil=True)
def blend_cells(pressure, cells, elements, row_share, column_share, first):
    """Move pressure coefficients (M, 3) towards `cells` (Q, C, 3) by the product of both shares."""
    for r in range(cells.shape[0]):
        for c in range(cells.shape[1]):
            share = row_share[r] * column_share[c]
            e = elements[r, first + c]
            for k in range(3):
                pressure[e, k] += share * (cells[r, c, k] - pressure[e, k])
