"""The tissue's mesh of nine-node quadrilaterals: a tensor grid with an O-grid round the lump. Units: mm.

Corners and cells are laid out here, every corner found by its place in a lattice, never by its coordinates,
so that no two can be mistaken. Mid-sides, middles, boundary and numbering are scikit-fem's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from skfem import Dofs, ElementQuad2, MeshQuad1, MeshQuad2

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.grid import Grid, lay_grid
from palpate.sim.tissue.layers import FAT, GLAND, LUMP, layer_at
from palpate.sim.tissue.settings import Settings

ALONG_THEN_UP: NDArray[np.int64] = np.lexsort(ElementQuad2.doflocs.T)
"""Nodes of scikit-fem's element in the order of the kernels."""

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class TissueMesh:
    """Nodes and elements of one geometry.

    Attributes
    ----------
    quads : MeshQuad2
        scikit-fem's mesh. Its degrees of freedom are numbered as the nodes are here, so that a displacement
        (2N,), x and y of each node in turn, is one of `ElementVector(ElementQuad2())`.
    nodes_mm : ndarray (N, 2)
        Node positions.
    elements : ndarray (M, 9)
        Their nodes, the first direction running fastest: node i + 3 j lies at (i/2, j/2).
    material : ndarray (M,)
        Numbers in `MATERIALS`: `FAT`, `GLAND`, `LUMP`, or a deeper layer's.
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
    lump_radius_mm : float
        Radius of the round lump; 0 where there is none.
    border_mm : float
        Height of the border between fat and gland over the lump's middle.
    """

    quads: MeshQuad2
    nodes_mm: Floats
    elements: Ints
    material: Ints
    column: Ints
    surface: Ints
    node_rows: Ints
    element_rows: Ints
    fixed: NDArray[np.bool_]
    lump_radius_mm: float
    border_mm: float = 0.0


def build_mesh(case: Case, settings: Settings, first_mm: float, last_mm: float) -> TissueMesh:
    """Mesh the tissue of `case` for positions between `first_mm` and `last_mm`.

    Raises
    ------
    CaseError
        The lump does not fit.
    """
    grid = lay_grid(meshed(case), settings, first_mm, last_mm)
    x, y = grid.x, grid.y
    nx, ny = len(x) - 1, len(y) - 1
    (i0, i1), (j0, j1) = grid.box_x, grid.box_y
    m, n, rings = i1 - i0, j1 - j0, grid.inner + grid.outer

    # The outer grid, without what lies inside the box.
    inside = _inside(grid)
    outer_id = np.full(inside.shape, -1)
    outer_id[~inside] = np.arange((~inside).sum())
    count = int((~inside).sum())

    # The core, a rounded square in the lump, and the closed loop of rings round it.
    core_id = count + np.arange((m + 1) * (n + 1)).reshape(m + 1, n + 1)
    count += core_id.size
    loop_i, loop_j = _perimeter(m, n)
    ring_id = np.empty((rings + 1, len(loop_i)), np.int64)
    ring_id[0] = core_id[loop_i, loop_j]
    ring_id[-1] = outer_id[i0 + loop_i, j0 + loop_j]
    ring_id[1:-1] = count + np.arange(ring_id[1:-1].size).reshape(ring_id[1:-1].shape)

    keep = np.ones((nx, ny), bool)
    keep[i0:i1, j0:j1] = False
    column = np.arange(nx) + np.where(np.arange(nx) >= i1, 2, np.where(np.arange(nx) >= i0, 1, 0)) * rings
    of_row = layer_at((y[:-1] + y[1:]) / 2, grid.borders)
    element_id = np.full((nx, ny), -1)
    element_id[keep] = np.arange(keep.sum())
    ring_column, ring_material = _ring_columns(grid, m, n)
    wrapped = np.concatenate([ring_id, ring_id[:, :1]], 1)
    cells = np.concatenate(
        [cells_of(outer_id)[keep], cells_of(core_id).reshape(-1, 4), cells_of(wrapped).reshape(-1, 4)]
    )
    loop = np.arange(len(cells) - ring_column.size, len(cells)).reshape(ring_column.shape)
    return mesh_of(
        corners_of(grid),
        cells,
        material=np.concatenate(
            [np.broadcast_to(of_row, (nx, ny))[keep], np.full(m * n, LUMP), ring_material.ravel()]
        ),
        column=np.concatenate(
            [
                np.broadcast_to(column[:, None], (nx, ny))[keep],
                np.repeat(i0 + rings + np.arange(m), n),
                ring_column.ravel(),
            ]
        ),
        element_rows=element_id[:, j1:].T.copy(),
        lump_radius_mm=grid.radius,
        round_layers=(loop[grid.inner - 1], loop[grid.inner]),
        border_mm=grid.borders[0],
    )


def corners_of(grid: Grid) -> Floats:
    """Corners (K, 2) of all cells: of the outer grid, of the core in the lump, and of the rings round it."""
    (i0, i1), (j0, j1) = grid.box_x, grid.box_y
    m, n = i1 - i0, j1 - j0
    outer_xy = np.stack(np.meshgrid(grid.x, grid.y, indexing="ij"), -1)
    core_xy = _core(grid, m)
    loop_i, loop_j = _perimeter(m, n)
    ring_xy = _rings(grid, m, core_xy[loop_i, loop_j], outer_xy[i0 + loop_i, j0 + loop_j])
    return np.concatenate([outer_xy[~_inside(grid)], core_xy.reshape(-1, 2), ring_xy[1:-1].reshape(-1, 2)])


def _inside(grid: Grid) -> NDArray[np.bool_]:
    """Which corners of the outer grid lie inside the box, and so are none: (columns + 1, rows + 1)."""
    out = np.zeros((len(grid.x), len(grid.y)), bool)
    out[grid.box_x[0] + 1 : grid.box_x[1], grid.box_y[0] + 1 : grid.box_y[1]] = True
    return out


def meshed(case: Case) -> Case:
    """The case whose mesh is used: plain tissue's is straight, as for a lump on the border."""
    if case.fat_mm is None or case.has_lump:
        return case
    plain = Case.without_lump(case.t_mm, gland_mm=case.gland_mm)
    return replace(case, d_mm=plain.d_mm, h=plain.h, fat_mm=None)


def mesh_of(
    corners: Floats,
    cells: Ints,
    material: Ints,
    column: Ints,
    element_rows: Ints,
    lump_radius_mm: float = 0.0,
    round_layers: tuple[Ints, Ints] | None = None,
    border_mm: float = 0.0,
) -> TissueMesh:
    """Nine-node elements on `corners` (K, 2) and `cells` (M, 4), anticlockwise, between four straight sides.

    `round_layers` are the elements inside and outside of the circle; the others are `TissueMesh`'s.
    """
    straight = MeshQuad1(corners.T.copy(), cells.T.copy())
    dofs = Dofs(straight, ElementQuad2())
    numbers = dofs.element_dofs
    nodes = _nodes(straight, numbers, lump_radius_mm, round_layers)
    elements = np.ascontiguousarray(numbers[ALONG_THEN_UP].T, dtype=np.int64)

    (left, bottom), (right, top) = nodes.min(1), nodes.max(1)
    x, y = nodes[:, dofs.facet_dofs[0]]  # the facets' middles
    surface = _nodes_on(dofs, y == top)
    fixed = np.zeros((nodes.shape[1], 2), bool)
    fixed[_nodes_on(dofs, y == bottom)] = True
    fixed[_nodes_on(dofs, (x == left) | (x == right)), 0] = True
    return TissueMesh(
        quads=MeshQuad2(nodes, straight.t),
        nodes_mm=nodes.T.copy(),
        elements=elements,
        material=material,
        column=column,
        surface=surface[np.argsort(nodes[0, surface])],
        node_rows=_node_rows(elements[element_rows]),
        element_rows=element_rows,
        fixed=fixed,
        lump_radius_mm=lump_radius_mm,
        border_mm=border_mm,
    )


def with_corners(mesh: TissueMesh, corners: Floats, grid: Grid) -> TissueMesh:
    """The same nodes and elements where the corners (K, 2) of another grid with the same layers have them."""
    loop = _perimeter(grid.box_x[1] - grid.box_x[0], grid.above + grid.below)[0].size
    first = len(mesh.elements) - (grid.inner + grid.outer) * loop
    inner = first + (grid.inner - 1) * loop + np.arange(loop)
    numbers = np.empty(mesh.elements.T.shape, np.int64)
    numbers[ALONG_THEN_UP] = mesh.elements.T
    straight = MeshQuad1(corners.T.copy(), mesh.quads.t)
    nodes = _nodes(straight, numbers, grid.radius, (inner, inner + loop))
    return replace(
        mesh,
        quads=MeshQuad2(nodes, mesh.quads.t),
        nodes_mm=nodes.T.copy(),
        lump_radius_mm=grid.radius,
        border_mm=grid.borders[0],
    )


def _nodes(
    straight: MeshQuad1, numbers: Ints, radius: float, round_layers: tuple[Ints, Ints] | None
) -> Floats:
    """Places (2, N) of the nodes `numbers` (9, M), in scikit-fem's order, of elements with straight sides.

    Between the two round layers of elements the sides lie on the circle of this radius.
    """
    nodes = np.empty((2, numbers.max() + 1))
    nodes[:, numbers] = straight.mapping().F(ElementQuad2.doflocs.T).transpose(0, 2, 1)
    if round_layers is not None:
        inner, outer = round_layers
        on_circle = numbers[5, inner]  # the middle of the second side, which is the inner layer's outer one
        nodes[:, on_circle] *= radius / np.hypot(*nodes[:, on_circle])
        for layer in (inner, outer):  # by transfinite interpolation
            some = nodes[:, numbers[:, layer]]
            nodes[:, numbers[8, layer]] = some[:, 4:8].sum(1) / 2 - some[:, :4].sum(1) / 4
    return nodes


def _nodes_on(dofs: Dofs, facets: NDArray[np.bool_]) -> Ints:
    return dofs.get_facet_dofs(np.nonzero(facets)[0]).all().astype(np.int64)


def _node_rows(cells: Ints) -> Ints:
    """Nodes of rows of elements (Q, C, 9), from below: (2 Q + 1, 2 C + 1)."""
    rows, columns = cells.shape[:2]
    three = cells.reshape(rows, columns, 3, 3).transpose(0, 2, 1, 3)  # row, height in it, column, along
    lines = np.concatenate([three[..., :2].reshape(rows, 3, -1), three[:, :, -1, 2:]], -1)
    return np.concatenate([lines[:, :2].reshape(2 * rows, -1), lines[-1, 2:]])


def cells_of(ids: Ints) -> Ints:
    """Four corners of every cell of a lattice, anticlockwise: (a+1, b+1) to (a, b, 4)."""
    return np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], -1)


def _core_parameters(grid: Grid, m: int) -> tuple[Floats, Floats]:
    below = np.linspace(-1.0, 0.0, grid.below + 1)
    return np.linspace(-1.0, 1.0, m + 1), np.concatenate([below, np.linspace(0.0, 1.0, grid.above + 1)[1:]])


def _core(grid: Grid, m: int) -> Floats:
    """Corners of the core's cells, (m+1, n+1, 2): a square with bulging sides."""
    s, q = np.meshgrid(*_core_parameters(grid, m), indexing="ij")
    size, bulge = 0.58 * grid.radius, 0.14
    square = np.stack([size * s * (1 + bulge * (1 - q * q)), size * q * (1 + bulge * (1 - s * s))], -1)
    return square + _yielded(grid, square, s, q)


def _yielded(grid: Grid, square: Floats, s: Floats, q: Floats) -> Floats:
    """How far the core's corners move where the border cuts the lump off its middle.

    Its rim turns with the circle and grows rounder where its corners draw near each other; what lies inside
    follows by transfinite interpolation. square : (m+1, n+1, 2), at s, q (m+1, n+1) from -1 to 1.
    """
    eighth, sides = np.pi / 4, np.hypot(*square[-1, grid.below])

    def moved(xy: Floats, by: Floats, rounder: Floats | float) -> Floats:
        size = 1 + rounder * (sides / np.hypot(xy[:, 0], xy[:, 1]) - 1)
        cos, sin, x, y = size * np.cos(by), size * np.sin(by), xy[:, 0], xy[:, 1]
        return np.stack([cos * x - sin * y - x, sin * x + cos * y - y], -1)

    at_lower, at_upper = -grid.turns[0] / eighth, grid.turns[2] / eighth
    rounder = np.where(q[0] < 0, at_lower, at_upper)
    by = _turn_of_side(grid, np.arctan2(square[-1, :, 1], square[-1, :, 0]) / eighth)
    right, left = moved(square[-1], by, rounder)[None], moved(square[0], -by, rounder)[None]
    along = np.arctan2(square[:, 0, 0], -square[:, 0, 1]) / eighth
    lower = moved(square[:, 0], grid.turns[0] * along, at_lower)[:, None]
    upper = moved(square[:, -1], grid.turns[2] * along, at_upper)[:, None]
    u, v = ((1 + s) / 2)[..., None], ((1 + q) / 2)[..., None]
    corners = (1 - u) * ((1 - v) * left[:, :1] + v * left[:, -1:])
    corners = corners + u * ((1 - v) * right[:, :1] + v * right[:, -1:])
    return (1 - u) * left + u * right + (1 - v) * lower + v * upper - corners


def _turn_of_side(grid: Grid, q: Floats) -> Floats:
    """By which angle the lines from the core's right side turn upwards, at `q` eighths of a turn."""
    return np.interp(q, (-1.0, 0.0, 1.0), grid.turns)


def _perimeter(m: int, n: int) -> tuple[Ints, Ints]:
    """Places of the core's border in its lattice, anticlockwise from its lower left corner."""
    i = np.concatenate([np.arange(m), np.full(n, m), np.arange(m, 0, -1), np.zeros(n, np.int64)])
    j = np.concatenate([np.zeros(m, np.int64), np.arange(n), np.full(m, n), np.arange(n, 0, -1)])
    return i, j


def _rings(grid: Grid, m: int, core_border: Floats, box_border: Floats) -> Floats:
    """Corners of the rings, (rings + 1, loop, 2), from the core's border over the circle to the box."""
    s, q = _core_parameters(grid, m)
    # On the circle each side's nodes are spread by angle.
    side = np.pi / 4 * q + _turn_of_side(grid, q)
    lower, upper = (np.pi / 4 + grid.turns[0]) * s, (np.pi / 4 - grid.turns[2]) * s
    angle = np.concatenate(
        [-np.pi / 2 + lower[:-1], side[:-1], np.pi / 2 - upper[:0:-1], np.pi - side[:0:-1]]
    )
    circle = grid.radius * np.stack([np.cos(angle), np.sin(angle)], -1)
    inner = np.arange(grid.inner)[:, None, None] / grid.inner
    outer = np.arange(grid.outer + 1)[:, None, None] / grid.outer
    return np.concatenate(
        [core_border + (circle - core_border) * inner, circle + (box_border - circle) * outer]
    )


def _ring_columns(grid: Grid, m: int, n: int) -> tuple[Ints, Ints]:
    """Column and material of the ring elements, each (rings, 2 m + 2 n)."""
    rings = grid.inner + grid.outer
    first = grid.box_x[0]
    ring = np.arange(rings)[:, None]
    middle = np.broadcast_to(first + rings + np.arange(m), (rings, m))
    right = np.broadcast_to(first + rings + m + ring, (rings, n))
    left = np.broadcast_to(first + rings - 1 - ring, (rings, n))
    column = np.concatenate([middle, right, middle[:, ::-1], left], 1)
    fat_side = np.arange(n) >= grid.in_gland
    lower, upper = np.full(m, grid.in_gland == 0), np.full(m, grid.in_gland < n)
    fat = np.concatenate([lower, fat_side, upper, fat_side[::-1]])
    return column, np.where(ring < grid.inner, LUMP, np.where(fat, FAT, GLAND))
