"""The tissue's mesh of nine-node quadrilaterals: a tensor grid with an O-grid round the lump. Units: mm.

Every node is found by its place in a lattice, never by its coordinates, so that no two can be mistaken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.tissue.case import Case
from sim.tissue.grid import Grid, lay_grid
from sim.tissue.settings import Settings

FAT, GLAND, LUMP = 0, 1, 2

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class TissueMesh:
    """Nodes and elements of one geometry.

    Attributes
    ----------
    nodes_mm : ndarray (N, 2)
        Node positions.
    elements : ndarray (M, 9)
        Their nodes, the first direction running fastest: node i + 3 j lies at (i/2, j/2).
    material : ndarray (M,)
        `FAT`, `GLAND` or `LUMP`.
    column : ndarray (M,)
        Number of the element's column from left to right; neighbours differ by at most one.
    surface : ndarray (S,)
        Nodes of the surface from left to right, corners and mid-sides in turn.
    node_rows : ndarray (R, S)
        Nodes of the grid's rows over the box, each from left to right.
    element_rows : ndarray (Q, S // 2)
        Elements of the same rows.
    fixed : ndarray (N, 2), bool
        Held degrees of freedom: the chest wall, and sideways the rollers at both ends.
    grid : Grid
        What it was laid on.
    """

    nodes_mm: Floats
    elements: Ints
    material: Ints
    column: Ints
    surface: Ints
    node_rows: Ints
    element_rows: Ints
    fixed: NDArray[np.bool_]
    grid: Grid


def build_mesh(case: Case, settings: Settings, first_mm: float, last_mm: float) -> TissueMesh:
    """Mesh the tissue of `case` for positions between `first_mm` and `last_mm`.

    Raises
    ------
    CaseError
        The lump does not fit.
    """
    grid = lay_grid(case, settings, first_mm, last_mm)
    x, y = grid.x, grid.y
    nx, ny = len(x) - 1, len(y) - 1
    (i0, i1), (j0, j1) = grid.box_x, grid.box_y
    m, n, rings = i1 - i0, j1 - j0, grid.inner + grid.outer

    # The outer grid, without what lies inside the box.
    outer_xy = np.stack(np.meshgrid(_halved(x), _halved(y), indexing="ij"), -1)
    inside = np.zeros(outer_xy.shape[:2], bool)
    inside[2 * i0 + 1 : 2 * i1, 2 * j0 + 1 : 2 * j1] = True
    outer_id = np.full(inside.shape, -1)
    outer_id[~inside] = np.arange((~inside).sum())
    count = int((~inside).sum())

    # The core, a rounded square in the lump, and the closed loop of rings round it.
    core_xy = _lattice(_core(grid, m))
    core_id = count + np.arange(core_xy[..., 0].size).reshape(core_xy.shape[:2])
    count += core_id.size
    loop_i, loop_j = _perimeter(m, n)
    ring_xy = _rings(grid, m, core_xy[loop_i, loop_j], outer_xy[2 * i0 + loop_i, 2 * j0 + loop_j])
    ring_id = np.empty(ring_xy.shape[:2], np.int64)
    ring_id[0] = core_id[loop_i, loop_j]
    ring_id[-1] = outer_id[2 * i0 + loop_i, 2 * j0 + loop_j]
    ring_id[1:-1] = count + np.arange(ring_id[1:-1].size).reshape(ring_id[1:-1].shape)

    nodes = np.concatenate([outer_xy[~inside], core_xy.reshape(-1, 2), ring_xy[1:-1].reshape(-1, 2)])
    keep = np.ones((nx, ny), bool)
    keep[i0:i1, j0:j1] = False
    column = np.arange(nx) + np.where(np.arange(nx) >= i1, 2, np.where(np.arange(nx) >= i0, 1, 0)) * rings
    outer_fat = np.where(y[:-1] >= -1e-9, FAT, GLAND)
    element_id = np.full((nx, ny), -1)
    element_id[keep] = np.arange(keep.sum())
    ring_column, ring_material = _ring_columns(grid, m, n)
    wrapped = np.concatenate([ring_id, ring_id[:, :1]], 1)

    nodes_fixed = np.zeros((len(nodes), 2), bool)
    nodes_fixed[outer_id[:, 0]] = True
    nodes_fixed[outer_id[[0, -1]], 0] = True
    return TissueMesh(
        nodes_mm=nodes,
        elements=np.concatenate(
            [_cells(outer_id)[keep], _cells(core_id).reshape(-1, 9), _cells(wrapped).reshape(-1, 9)]
        ),
        material=np.concatenate(
            [np.broadcast_to(outer_fat, (nx, ny))[keep], np.full(m * n, LUMP), ring_material.ravel()]
        ),
        column=np.concatenate(
            [
                np.broadcast_to(column[:, None], (nx, ny))[keep],
                np.repeat(i0 + rings + np.arange(m), n),
                ring_column.ravel(),
            ]
        ),
        surface=outer_id[:, -1].copy(),
        node_rows=outer_id[:, 2 * j1 :].T.copy(),
        element_rows=element_id[:, j1:].T.copy(),
        fixed=nodes_fixed,
        grid=grid,
    )


def _halved(borders: Floats) -> Floats:
    out = np.empty(2 * len(borders) - 1)
    out[::2] = borders
    out[1::2] = (borders[1:] + borders[:-1]) / 2
    return out


def _lattice(corners: Floats) -> Floats:
    """Nodes of straight-sided cells: corners (a+1, b+1, 2) to nodes (2a+1, 2b+1, 2)."""
    a, b = corners.shape[0] - 1, corners.shape[1] - 1
    out = np.empty((2 * a + 1, 2 * b + 1, 2))
    out[::2, ::2] = corners
    out[1::2, ::2] = (corners[1:] + corners[:-1]) / 2
    out[:, 1::2] = (out[:, 2::2] + out[:, :-1:2]) / 2
    return out


def _cells(ids: Ints) -> Ints:
    """Nine nodes of every cell of a node lattice: (2a+1, 2b+1) to (a, b, 9)."""
    a, b = ids.shape[0] // 2, ids.shape[1] // 2
    return np.stack([ids[i : i + 2 * a : 2, j : j + 2 * b : 2] for j in range(3) for i in range(3)], -1)


def _core_parameters(grid: Grid, m: int) -> tuple[Floats, Floats]:
    below = np.linspace(-1.0, 0.0, grid.below + 1)
    return np.linspace(-1.0, 1.0, m + 1), np.concatenate([below, np.linspace(0.0, 1.0, grid.above + 1)[1:]])


def _core(grid: Grid, m: int) -> Floats:
    """Corners of the core's cells, (m+1, n+1, 2): a square with bulging sides."""
    s, q = np.meshgrid(*_core_parameters(grid, m), indexing="ij")
    size, bulge = 0.58 * grid.radius, 0.14
    return np.stack([size * s * (1 + bulge * (1 - q * q)), size * q * (1 + bulge * (1 - s * s))], -1)


def _perimeter(m: int, n: int) -> tuple[Ints, Ints]:
    """Lattice places of the core's border, anticlockwise from its lower left corner."""
    a, b = 2 * m, 2 * n
    i = np.concatenate([np.arange(a), np.full(b, a), np.arange(a, 0, -1), np.zeros(b, np.int64)])
    j = np.concatenate([np.zeros(a, np.int64), np.arange(b), np.full(a, b), np.arange(b, 0, -1)])
    return i, j


def _rings(grid: Grid, m: int, core_border: Floats, box_border: Floats) -> Floats:
    """Nodes of the rings, (2 rings + 1, loop, 2), from the core's border over the circle to the box."""
    s, q = _core_parameters(grid, m)
    # On the circle the corners of the core keep 45 degrees; each side's nodes are spread by angle.
    angle = np.concatenate(
        [
            -np.pi / 2 + np.pi / 4 * s[:-1],
            np.pi / 4 * q[:-1],
            np.pi / 2 - np.pi / 4 * s[:0:-1],
            np.pi - np.pi / 4 * q[:0:-1],
        ]
    )
    circle = grid.radius * np.stack([np.cos(angle), np.sin(angle)], -1)
    inner = np.arange(grid.inner)[:, None, None] / grid.inner
    outer = np.arange(grid.outer + 1)[:, None, None] / grid.outer
    core, box = core_border[::2], box_border[::2]
    corners = np.concatenate([core + (circle - core) * inner, circle + (box - circle) * outer])
    closed = np.concatenate([corners, corners[:, :1]], 1)
    nodes = _lattice(closed)
    on_circle = nodes[2 * grid.inner, 1::2]
    on_circle *= grid.radius / np.hypot(on_circle[:, 0], on_circle[:, 1])[:, None]
    # Middles of cells with a curved side, by transfinite interpolation.
    sides = nodes[:-1:2, 1::2] + nodes[2::2, 1::2] + nodes[1::2, :-1:2] + nodes[1::2, 2::2]
    ends = nodes[:-1:2, :-1:2] + nodes[2::2, :-1:2] + nodes[:-1:2, 2::2] + nodes[2::2, 2::2]
    nodes[1::2, 1::2] = sides / 2 - ends / 4
    return nodes[:, :-1]


def _ring_columns(grid: Grid, m: int, n: int) -> tuple[Ints, Ints]:
    """Column and material of the ring elements, each (rings, 2 m + 2 n)."""
    rings = grid.inner + grid.outer
    first = grid.box_x[0]
    ring = np.arange(rings)[:, None]
    middle = np.broadcast_to(first + rings + np.arange(m), (rings, m))
    right = np.broadcast_to(first + rings + m + ring, (rings, n))
    left = np.broadcast_to(first + rings - 1 - ring, (rings, n))
    column = np.concatenate([middle, right, middle[:, ::-1], left], 1)
    fat_side = np.arange(n) >= grid.below
    fat = np.concatenate([np.zeros(m, bool), fat_side, np.ones(m, bool), fat_side[::-1]])
    return column, np.where(ring < grid.inner, LUMP, np.where(fat, FAT, GLAND))
