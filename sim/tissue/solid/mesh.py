"""The solid mesh of 27-node hexahedra: a tensor grid with shells round the lump, as a scikit-fem mesh.

Every node is found by its place in a lattice, never by its coordinates. Nodes and degrees of freedom are
numbered as scikit-fem numbers them. Units: mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skfem import ElementHex2, MeshHex1, MeshHex2

from palpate.sim.tissue.solid.grid import SolidGrid

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

LATTICE_OF_LOCAL = (2 * ElementHex2.doflocs).astype(int) @ np.array([1, 3, 9])
"""Place a + 3 b + 9 c in an element's lattice, at (a, b, c)/2, of each of scikit-fem's local nodes."""

_CORE = 0.5
_BULGE = 0.12
_OUTWARDS = 1.5
"""Shells round the lump thicken outwards by this power: what is round a hard lump bends most beside it."""


@dataclass(frozen=True)
class SolidMesh:
    """Nodes and elements of one geometry.

    Attributes
    ----------
    fem : MeshHex2
        The same for scikit-fem.
    nodes_mm : ndarray (N, 3)
        Node positions.
    elements : ndarray (M, 27)
        Their nodes in scikit-fem's local order.
    lump : ndarray (M,), bool
        Which elements fill the lump's ellipsoid.
    node_lattice : ndarray (2 nx + 1, 2 ny + 1, 2 nz + 1)
        Nodes of the outer grid, -1 inside the box.
    element_lattice : ndarray (nx, ny, nz)
        Its elements, -1 inside the box.
    surface : ndarray (2 nx + 1, 2 nz + 1)
        Nodes of the skin.
    fixed : ndarray (N, 3), bool
        Held degrees of freedom: the chest wall, and the rollers at the sides and planes of symmetry.
    grid : SolidGrid
        What it was laid on.
    """

    fem: MeshHex2
    nodes_mm: Floats
    elements: Ints
    lump: NDArray[np.bool_]
    node_lattice: Ints
    element_lattice: Ints
    surface: Ints
    fixed: NDArray[np.bool_]
    grid: SolidGrid


def build_mesh(grid: SolidGrid) -> SolidMesh:
    """Mesh the tissue of a grid."""
    lines = [_halved(v) for v in (grid.x, grid.y, grid.z)]
    outer_xyz = np.stack(np.meshgrid(*lines, indexing="ij"), -1)
    cells = [len(v) - 1 for v in (grid.x, grid.y, grid.z)]
    if grid.box is None:
        outer_id = np.arange(outer_xyz[..., 0].size).reshape(outer_xyz.shape[:3])
        keep = np.ones(cells, bool)
        nodes, elements, lump = (
            outer_xyz.reshape(-1, 3),
            _cells(outer_id).reshape(-1, 27),
            np.zeros(keep.size, bool),
        )
    else:
        inside = np.zeros(outer_xyz.shape[:3], bool)
        keep = np.ones(cells, bool)
        (a0, a1), (b0, b1), (c0, c1) = grid.box
        inside[2 * a0 + 1 : 2 * a1, 2 * b0 + 1 : 2 * b1, _inner_layers(grid)] = True
        keep[a0:a1, b0:b1, c0:c1] = False
        outer_id = np.full(inside.shape, -1)
        outer_id[~inside] = np.arange((~inside).sum())
        inner_xyz, inner, in_lump = _fill_box(grid, lines, outer_id)
        nodes = np.concatenate([outer_xyz[~inside], inner_xyz])
        elements = np.concatenate([_cells(outer_id)[keep], inner])
        lump = np.concatenate([np.zeros(keep.sum(), bool), in_lump])
    fem, number, elements = _as_fem(nodes, elements)
    element_lattice = np.full(keep.shape, -1)
    element_lattice[keep] = np.arange(keep.sum())
    node_lattice = np.where(outer_id >= 0, number[outer_id], -1)
    where = fem.doflocs
    low, high = where.min(1), where.max(1)
    fixed = np.zeros((where.shape[1], 3), bool)
    fixed[where[1] < low[1] + 1e-9] = True
    for axis in (0, 2):
        fixed[(where[axis] < low[axis] + 1e-9) | (where[axis] > high[axis] - 1e-9), axis] = True
    return SolidMesh(
        fem=fem,
        nodes_mm=np.ascontiguousarray(where.T),
        elements=elements,
        lump=lump,
        node_lattice=node_lattice,
        element_lattice=element_lattice,
        surface=node_lattice[:, -1],
        fixed=fixed,
        grid=grid,
    )


def _as_fem(nodes: Floats, lattices: Ints) -> tuple[MeshHex2, Ints, Ints]:
    """scikit-fem's mesh, the numbers that our nodes have there, and the elements in its local order."""
    ours = lattices[:, LATTICE_OF_LOCAL]
    corners, t = np.unique(ours[:, :8], return_inverse=True)
    straight = MeshHex1(np.ascontiguousarray(nodes[corners].T), np.ascontiguousarray(t.reshape(-1, 8).T))
    fem = MeshHex2.from_mesh(straight)
    theirs = fem.dofs.element_dofs.T.astype(np.int64)
    number = np.full(len(nodes), -1)
    number[ours] = theirs
    where = np.empty_like(fem.doflocs)
    where[:, theirs] = nodes[ours].transpose(2, 0, 1)
    return MeshHex2(where, fem.t), number, np.ascontiguousarray(theirs)


def _fill_box(grid: SolidGrid, lines: list[Floats], outer_id: Ints) -> tuple[Floats, Ints, NDArray[np.bool_]]:
    """Nodes inside the box, its elements' lattices of 27 nodes, and which of them are the lump's."""
    assert grid.box is not None
    part = tuple(slice(2 * a, 2 * b + 1) for a, b in grid.box)
    box_id = outer_id[part]
    box_xyz = np.stack(np.meshgrid(*(v[p] for v, p in zip(lines, part)), indexing="ij"), -1)
    s = _parameters(grid, box_id.shape)
    axes = range(2 if grid.through else 3)
    on_skin = np.zeros(box_id.shape, bool)
    for axis in axes:
        ends = np.moveaxis(on_skin, axis, 0)
        ends[-1] = True
        if axis < 2 or not grid.half:
            ends[0] = True
    if grid.through:
        s[..., 2] = 0.0
    core_xyz = _core(s)
    ball_xyz = np.tan(np.pi / 4 * s)
    ball_xyz[on_skin] /= np.linalg.norm(ball_xyz[on_skin], axis=-1, keepdims=True)
    core_xyz, ball_xyz = _to_lump(grid, core_xyz), _to_lump(grid, ball_xyz)
    if grid.through:
        core_xyz[..., 2] = ball_xyz[..., 2] = box_xyz[..., 2]

    layers = [core_xyz + (ball_xyz - core_xyz) * (k / (2 * grid.inner)) for k in range(2 * grid.inner)]
    layers += [ball_xyz + (box_xyz - ball_xyz) * share for share in _outwards(grid.outer)]
    count = outer_id.max() + 1
    core_id = count + np.arange(box_id.size).reshape(box_id.shape)
    count += core_id.size
    nodes, ids = [core_xyz.reshape(-1, 3)], [core_id]
    for layer in layers[1:]:
        ids.append(np.full(box_id.shape, -1))
        ids[-1][on_skin] = count + np.arange(on_skin.sum())
        count += int(on_skin.sum())
        nodes.append(layer[on_skin])
    ids.append(box_id)

    elements = [_cells(core_id).reshape(-1, 27)]
    lump = [np.ones(len(elements[0]), bool)]
    for axis in axes:
        for end in (0, -1):
            if axis == 2 and end == 0 and grid.half:
                continue
            face = np.stack([np.take(layer, end, axis) for layer in ids])
            right_handed = face if (axis != 1) == (end == -1) else face[:, ::-1]
            patches = _cells(right_handed)
            elements.append(patches.reshape(-1, 27))
            shell = np.broadcast_to(np.arange(patches.shape[0])[:, None, None], patches.shape[:3])
            lump.append((shell < grid.inner).ravel())
    return np.concatenate(nodes), np.concatenate(elements), np.concatenate(lump)


def _outwards(shells: int) -> Floats:
    """How far out nodes lie between the lump and its box, 0 to 1, less the box's own."""
    borders = (np.arange(shells + 1) / shells) ** _OUTWARDS
    return np.stack([borders[:-1], (borders[:-1] + borders[1:]) / 2], -1).ravel()


def _inner_layers(grid: SolidGrid) -> slice:
    """Lattice layers inside the box, which has no skin where a plane of symmetry or the tissue's end cuts
    it."""
    assert grid.box is not None
    first, last = (2 * border for border in grid.box[2])
    return slice(first if grid.half else first + 1, last + 1 if grid.through else last)


def _parameters(grid: SolidGrid, shape: tuple[int, ...]) -> Floats:
    """The box's own coordinates of its lattice, from -1 to 1 (from 0 across the half model), (..., 3)."""
    along = np.linspace(-1.0, 1.0, shape[0])
    up = np.linspace(-1.0, 1.0, shape[1])
    across = np.linspace(0.0 if grid.half else -1.0, 1.0, shape[2])
    return np.stack(np.meshgrid(along, up, across, indexing="ij"), -1)


def _core(s: Floats) -> Floats:
    """A cube with bulging sides inside the unit ball."""
    squares = s * s
    others = squares.sum(-1, keepdims=True) - squares
    return _CORE * s * (1 + _BULGE * (2 - others))


def _to_lump(grid: SolidGrid, unit: Floats) -> Floats:
    """Points of the unit ball, in the lump; its equator goes where the border cuts the lump.

    A Moebius map of the ball carries the equator to another latitude and keeps all angles.
    """
    a = np.array([0.0, -_latitude(grid.split / grid.half_axes[1]), 0.0])
    aa, along, square = a @ a, unit @ a, (unit * unit).sum(-1)
    scale = 1 - 2 * along + square * aa
    moved = ((1 - aa) * unit - (1 - 2 * along + square)[..., None] * a) / scale[..., None]
    return moved * np.array(grid.half_axes) + np.array([0.0, 0.0, grid.offset])


def _latitude(height: float) -> float:
    """The Moebius parameter that carries the equator to this height on the unit sphere: 2 a / (1 + a^2)."""
    return 0.0 if height == 0.0 else (1 - np.sqrt(1 - height * height)) / height


def _halved(borders: Floats) -> Floats:
    out = np.empty(2 * len(borders) - 1)
    out[::2] = borders
    out[1::2] = (borders[1:] + borders[:-1]) / 2
    return out


def _cells(ids: Ints) -> Ints:
    """27 nodes of every cell of a node lattice: (2a+1, 2b+1, 2c+1) to (a, b, c, 27)."""
    a, b, c = (n // 2 for n in ids.shape)
    corners = [
        ids[i : i + 2 * a : 2, j : j + 2 * b : 2, k : k + 2 * c : 2]
        for k in range(3)
        for j in range(3)
        for i in range(3)
    ]
    return np.stack(corners, -1)
