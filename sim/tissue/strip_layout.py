"""Which unknowns `strip.py` eliminates when: the symbolic half of its factorisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.tissue import strip_symbolic as symbolic
from sim.tissue.mesh import TissueMesh

Ints = NDArray[np.int64]

CORNERS_AND_SIDES = np.array([0, 1, 2, 3, 5, 6, 7, 8])
MIDDLE = 4
_BOTH = np.array([0, 1])


@dataclass(frozen=True)
class Columns:
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


@dataclass(frozen=True)
class Chain:
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
    first, last = columns.first, columns.last
    if flipped:
        first, last = count - 1 - last, count - 1 - first
    free = ~mesh.fixed.ravel()
    place = np.full(free.size, -1, np.int32)  # of the unknowns, in the step that is being laid out
    outer = mesh.elements[:, CORNERS_AND_SIDES]
    outer = np.concatenate([2 * outer, 2 * outer + 1], 1)
    surface = np.stack([2 * mesh.surface, 2 * mesh.surface + 1], 1)
    element_place, surface_place = np.empty(outer.shape, np.int32), np.empty(surface.shape, np.int64)
    lists, incoming = [], []
    interior, pivots = np.zeros(count, np.int64), np.zeros(count, np.int64)
    front = np.zeros(0, np.int64)
    by_first = np.argsort(first, kind="stable")
    starts = np.searchsorted(first[by_first], np.arange(count + 1))
    open_nodes = np.zeros(0, np.int64)  # places in columns.nodes, up or down
    for g in range(count):
        # Up and down in turn: the interior is then eliminated along one growing range of the others,
        # the end of those that leave and the beginning of those that stay.
        turn = 1 if g % 2 else -1
        new = np.sort(by_first[starts[g] : starts[g + 1]])
        inner = _dofs(columns.nodes[new[last[new] == g][::-turn]], free)
        leaving = _dofs(columns.nodes[open_nodes[last[open_nodes] == g]], free)
        stay = np.sort(np.concatenate([open_nodes[last[open_nodes] > g], new[last[new] > g]]))
        open_nodes = stay[::-turn]
        staying = _dofs(columns.nodes[open_nodes], free)
        these = np.concatenate([inner, leaving, staying])
        place[these] = np.arange(len(these))
        incoming.append(place[front].astype(np.int64))
        column = count - 1 - g if flipped else g
        some = columns.elements[columns.element_starts[column] : columns.element_starts[column + 1]]
        element_place[some] = place[outer[some]]
        some = columns.surface[columns.surface_starts[column] : columns.surface_starts[column + 1]]
        surface_place[some] = place[surface[some]]
        lists.append(these)
        interior[g], pivots[g] = len(inner), len(inner) + len(leaving)
        front = staying
    size = np.array([len(these) for these in lists])
    stride = (int(size.max()) // 8 + 1) * 8
    spans = symbolic.reach(interior, size, columns.elements, columns.element_starts, element_place, flipped)
    lengths = symbolic.row_lengths(interior, pivots, size, spans)
    return Chain(
        dofs=_padded(lists),
        interior=interior,
        pivots=pivots,
        size=size,
        incoming=_padded(incoming),
        incoming_size=np.array([len(these) for these in incoming]),
        together=np.array([bool((these[1:] - these[:-1] == 1).all()) for these in incoming]),
        spans=spans,
        row_starts=np.concatenate([[0], np.cumsum(lengths)]),
        targets=symbolic.targets(element_place, stride),
        surface_place=surface_place,
        stride=stride,
    )


def _dofs(nodes: Ints, free: NDArray[np.bool_]) -> Ints:
    both = (2 * nodes[:, None] + _BOTH).ravel()
    return both[free[both]]


def _padded(lists: list[Ints]) -> Ints:
    out = np.full((len(lists), max(1, *map(len, lists))), -1, np.int64)
    for row, these in zip(out, lists):
        row[: len(these)] = these
    return out
