"""Which unknowns `strip.py` eliminates when: the symbolic half of its factorisation.

`Columns` and `Chain` are named tuples because compiled code takes these as they are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.mesh import TissueMesh
from palpate.sim.tissue.solver import strip_symbolic as symbolic

Ints = NDArray[np.int64]

CORNERS_AND_SIDES = np.array([0, 1, 2, 3, 5, 6, 7, 8])
MIDDLE = 4


class Columns(NamedTuple):
    """What both directions share.

    Attributes
    ----------
    nodes : ndarray (K,)
        All nodes but the elements' middles, from bottom to top.
    first, last : ndarray (K,)
        First and last column that each of them touches.
    elements, element_starts
        Elements sorted by column, and where each column begins.
    surface, surface_starts
        The same for the surface's nodes (places in `mesh.surface`), each in the first column it touches.
    """

    nodes: Ints
    first: Ints
    last: Ints
    elements: Ints
    element_starts: Ints
    surface: Ints
    surface_starts: Ints


class Unknowns(NamedTuple):
    """The mesh's unknowns.

    Attributes
    ----------
    of_elements : ndarray (M, 16)
        Of each element's corners and sides.
    of_surface : ndarray (S, 2)
        Of each of the surface's nodes.
    fixed : ndarray (2 N,), bool
        Which are held.
    """

    of_elements: Ints
    of_surface: Ints
    fixed: NDArray[np.bool_]


class Chain(NamedTuple):
    """Elimination of the columns in one direction; a step is a column, counted in that direction.

    Attributes
    ----------
    dofs : ndarray (steps, widest)
        Unknowns of each step: interior ones, those that leave the front, those that stay.
    interior, pivots, size : ndarray (steps,)
        How many are interior; how many are eliminated; how many there are.
    incoming, incoming_size : ndarray (steps, widest front), (steps,)
        Places in `dofs` of the front that comes in.
    together : ndarray (steps,), bool
        Whether these are consecutive.
    spans : ndarray (steps, chunks, 3)
        How far the interior rows reach; see `symbolic.reach`.
    row_starts : ndarray (steps + 1,)
        Where every step's rows begin in the factor's memory.
    targets : ndarray (M, 136)
        Where the upper triangle of a condensed element goes in a square of side `stride`; what is held
        goes to its last place.
    surface_place : ndarray (S, 2)
        Places of the surface's unknowns in the step they are added in.
    stride : int
        Side of the square, larger than any step.
    """

    dofs: Ints
    interior: Ints
    pivots: Ints
    size: Ints
    incoming: Ints
    incoming_size: Ints
    together: NDArray[np.bool_]
    spans: Ints
    row_starts: Ints
    targets: Ints
    surface_place: Ints
    stride: int


def lay_out_columns(mesh: TissueMesh) -> Columns:
    """Sort nodes, elements and surface into columns."""
    count = int(mesh.column.max()) + 1
    first = np.full(len(mesh.nodes_mm), count)
    last = np.full(len(mesh.nodes_mm), -1)
    np.minimum.at(first, mesh.elements, mesh.column[:, None])
    np.maximum.at(last, mesh.elements, mesh.column[:, None])
    elements = np.argsort(mesh.column, kind="stable")
    middle = np.zeros(len(first), bool)
    middle[mesh.elements[:, MIDDLE]] = True
    nodes = np.lexsort((mesh.nodes_mm[:, 0], mesh.nodes_mm[:, 1]))
    nodes = nodes[~middle[nodes]]
    surface_column = first[mesh.surface]
    surface = np.argsort(surface_column, kind="stable")
    borders = np.arange(count + 1)
    return Columns(
        nodes=nodes,
        first=first[nodes],
        last=last[nodes],
        elements=elements,
        element_starts=np.searchsorted(mesh.column[elements], borders),
        surface=surface,
        surface_starts=np.searchsorted(surface_column[surface], borders),
    )


def lay_out_chain(mesh: TissueMesh, columns: Columns, flipped: bool) -> Chain:
    """Order the unknowns of one direction: from the left, or `flipped` from the right."""
    count = len(columns.element_starts) - 1
    if flipped:
        columns = columns._replace(first=count - 1 - columns.last, last=count - 1 - columns.first)
    by_first = np.argsort(columns.first, kind="stable")
    starts = np.searchsorted(columns.first[by_first], np.arange(count + 1))
    outer = mesh.elements[:, CORNERS_AND_SIDES]
    unknowns = Unknowns(
        of_elements=np.concatenate([2 * outer, 2 * outer + 1], 1),
        of_surface=np.stack([2 * mesh.surface, 2 * mesh.surface + 1], 1),
        fixed=mesh.fixed.ravel(),
    )
    order = symbolic.order(columns, unknowns, by_first, starts, flipped)
    stride = (int(order.size.max()) // 8 + 1) * 8
    spans = symbolic.reach(
        order.interior, order.size, columns.elements, columns.element_starts, order.element_place, flipped
    )
    lengths = symbolic.row_lengths(order.interior, order.pivots, order.size, spans)
    return Chain(
        dofs=order.dofs,
        interior=order.interior,
        pivots=order.pivots,
        size=order.size,
        incoming=order.incoming,
        incoming_size=order.incoming_size,
        together=symbolic.together(order.incoming, order.incoming_size),
        spans=spans,
        row_starts=np.concatenate([[0], np.cumsum(lengths)]),
        targets=symbolic.targets(order.element_place, stride),
        surface_place=order.surface_place,
        stride=stride,
    )
