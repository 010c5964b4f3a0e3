"""Compiled loops of `strip_layout.py`: what reaches where."""

# mypy: ignore-errors
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit


class Order(NamedTuple):
    """The unknowns of every step of a chain in their order; most of it as `strip_layout.Chain` has it.

    Attributes
    ----------
    element_place, surface_place : ndarray (M, 16), (S, 2)
        Places of the elements' and the surface's unknowns in their steps, below 0 where held.
    """

    dofs: np.ndarray
    interior: np.ndarray
    pivots: np.ndarray
    size: np.ndarray
    incoming: np.ndarray
    incoming_size: np.ndarray
    element_place: np.ndarray
    surface_place: np.ndarray


@njit(cache=True, nogil=True)
def order(columns, unknowns, by_first, starts, flipped):
    """Order the unknowns of every step of a chain: interior, leaving the front, staying in it.

    Parameters
    ----------
    columns, unknowns : Columns, Unknowns
        Of `strip_layout`; the columns are counted in the chain's direction.
    by_first, starts : ndarray (K,), (steps + 1,)
        Nodes by the step that touches them first, as places in `columns.nodes`, and where each step begins.
    flipped : bool
        The chain goes from the right to the left.

    Returns
    -------
    Order
    """
    nodes = columns.nodes
    first = columns.first
    last = columns.last
    fixed = unknowns.fixed
    steps = len(starts) - 1
    widest = 1
    for g in range(steps):
        n = 0
        for k in range(len(nodes)):
            if first[k] <= g <= last[k]:
                n += 2
        widest = max(widest, n)
    dofs = np.full((steps, widest), -1, np.int64)
    incoming = np.full((steps, widest), -1, np.int64)
    interior = np.zeros(steps, np.int64)
    pivots = np.zeros(steps, np.int64)
    size = np.zeros(steps, np.int64)
    incoming_size = np.zeros(steps, np.int64)
    place = np.full(len(fixed), -1, np.int32)  # of the unknowns, in the step that is being laid out
    element_place = np.empty(unknowns.of_elements.shape, np.int32)
    surface_place = np.empty(unknowns.of_surface.shape, np.int64)
    staying = np.empty(len(nodes), np.int64)  # places in `nodes`, up or down
    count = 0
    for g in range(steps):
        # Up and down in turn: the interior is then eliminated along one growing range of the others,
        # the end of those that leave and the beginning of those that stay.
        up = g % 2 == 0
        new = by_first[starts[g] : starts[g + 1]]
        these = dofs[g]
        n = 0
        for i in range(len(new)):
            k = new[i] if up else new[len(new) - 1 - i]
            if last[k] == g:
                n = _append(these, n, nodes[k], fixed)
        interior[g] = n
        stay = np.empty(count + len(new), np.int64)
        m = 0
        for k in staying[:count]:
            if last[k] == g:
                n = _append(these, n, nodes[k], fixed)
            elif last[k] > g:
                stay[m] = k
                m += 1
        pivots[g] = n
        for k in new:
            if last[k] > g:
                stay[m] = k
                m += 1
        stay = np.sort(stay[:m])
        count = m
        for i in range(m):
            staying[i] = stay[i] if up else stay[m - 1 - i]
            n = _append(these, n, nodes[staying[i]], fixed)
        size[g] = n
        for i in range(n):
            place[these[i]] = i
        if g > 0:
            incoming_size[g] = size[g - 1] - pivots[g - 1]
            for i in range(incoming_size[g]):
                incoming[g, i] = place[dofs[g - 1, pivots[g - 1] + i]]
        column = steps - 1 - g if flipped else g
        for e in columns.elements[columns.element_starts[column] : columns.element_starts[column + 1]]:
            for i in range(16):
                element_place[e, i] = place[unknowns.of_elements[e, i]]
        for s in columns.surface[columns.surface_starts[column] : columns.surface_starts[column + 1]]:
            surface_place[s, 0] = place[unknowns.of_surface[s, 0]]
            surface_place[s, 1] = place[unknowns.of_surface[s, 1]]
    return Order(dofs, interior, pivots, size, incoming, incoming_size, element_place, surface_place)


@njit(cache=True, nogil=True)
def _append(these, n, node, fixed):
    """Put a node's free unknowns at the end of the first `n`; returns how many there are now."""
    for dof in range(2 * node, 2 * node + 2):
        if not fixed[dof]:
            these[n] = dof
            n += 1
    return n


@njit(cache=True, nogil=True)
def reach(interior, size, elements, starts, place, flipped):
    """Symbolic elimination of every step's interior: how far the rows of four at a time reach.

    Returns (steps, chunks, 3): end of the interior range; begin and end of the range among the others.
    """
    steps = len(size)
    chunks = (max(1, interior.max()) + 3) // 4
    spans = np.zeros((steps, chunks, 3), np.int64)
    words = int(size.max()) // 64 + 1
    full = np.zeros((interior.max(), words), np.uint64)  # a bit for every number that is not 0
    some = np.zeros(words, np.uint64)
    for g in range(steps):
        c = steps - 1 - g if flipped else g
        m = interior[g]
        n = size[g]
        full[:m] = 0
        for e in elements[starts[c] : starts[c + 1]]:
            some[:] = 0
            for a in range(16):
                if place[e, a] >= 0:
                    some[place[e, a] >> 6] |= _ONE << np.uint64(place[e, a] & 63)
            for a in range(16):
                if 0 <= place[e, a] < m:
                    full[place[e, a]] |= some
        for k in range(m):
            for i in range(k + 1, m):
                if _bit(full[k], i):
                    full[i] |= full[k]
        for chunk in range((m + 3) // 4):
            last = min(4 * chunk + 4, m)
            some[:] = 0
            for k in range(4 * chunk, last):
                some |= full[k]
            inner = m
            while inner > last and not _bit(some, inner - 1):
                inner -= 1
            begin = m
            while begin < n and not _bit(some, begin):
                begin += 1
            end = n
            while end > m and not _bit(some, end - 1):
                end -= 1
            spans[g, chunk, 0] = inner
            spans[g, chunk, 1] = min(begin, end)
            spans[g, chunk, 2] = end
    return spans


_ONE = np.uint64(1)


@njit(cache=True, nogil=True, inline="always")
def _bit(words, i):
    return (words[i >> 6] >> np.uint64(i & 63)) & _ONE


@njit(cache=True, nogil=True)
def together(incoming, incoming_size):
    """Whether the places of every step's incoming front are consecutive."""
    out = np.ones(len(incoming_size), np.bool_)
    for g in range(len(out)):
        for i in range(1, incoming_size[g]):
            if incoming[g, i] != incoming[g, i - 1] + 1:
                out[g] = False
    return out


@njit(cache=True, nogil=True)
def row_lengths(interior, pivots, size, spans):
    """How many numbers every step keeps."""
    out = np.zeros(len(size), np.int64)
    for g in range(len(size)):
        for k in range(pivots[g]):
            if k < interior[g]:
                span = spans[g, k // 4]
                out[g] += span[0] - k + span[2] - span[1]
            else:
                out[g] += size[g] - k
    return out


@njit(cache=True, nogil=True)
def targets(place, stride):
    """Where in a flat square of side `stride` the upper triangles (M, 136) of elements go.

    `place` (M, 16) holds the row of each of their unknowns, below 0 where it is held; the square's last
    number takes what is not wanted.
    """
    out = np.empty((place.shape[0], 136), np.int32)
    for e in range(place.shape[0]):
        k = 0
        for i in range(16):
            for j in range(i, 16):
                a = place[e, i]
                b = place[e, j]
                if a < 0 or b < 0:
                    out[e, k] = stride * stride - 1
                else:
                    out[e, k] = min(a, b) * stride + max(a, b)
                k += 1
    return out
