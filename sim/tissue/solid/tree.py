"""Nested dissection of a solid mesh: halves of halves of its elements, parted by the nodes that they
share."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

_LEAF = 4
"""Elements that are eliminated together at the bottom."""

_SIDE = 12.0
"""Unknowns on an element's side that are not its neighbours' as well: four nodes'."""


@dataclass
class Branch:
    """One step of the elimination.

    Attributes
    ----------
    children : list of int
        The branches that come before it; none at the bottom.
    elements : ndarray
        Elements to assemble here, at the bottom.
    pivots : ndarray
        Nodes that are eliminated here.
    border : ndarray
        Nodes that remain, in the order of their elimination.
    """

    children: list[int]
    elements: Ints
    pivots: Ints
    border: Ints = field(default_factory=lambda: np.empty(0, np.int64))


def dissect(elements: Ints, centres_mm: Floats, free: NDArray[np.bool_]) -> list[Branch]:
    """The elimination's tree, children before parents.

    Parameters
    ----------
    elements : ndarray (M, 27)
        Nodes of the elements.
    centres_mm : ndarray (M, 3)
        Their middles.
    free : ndarray (N,), bool
        Nodes that are not held altogether; the others take no part.
    """
    part = _Dissection(elements, centres_mm, free)
    part.divide(np.arange(len(elements)))
    place = np.full(len(free), -1, np.int64)
    count = 0
    for branch in part.branches:
        place[branch.pivots] = count + np.arange(len(branch.pivots))
        count += len(branch.pivots)
    eliminated = np.zeros(len(free), bool)
    for branch in part.branches:
        eliminated[branch.pivots] = True
        below = [part.branches[child].border for child in branch.children]
        nodes = np.unique(np.concatenate(below)) if below else part.nodes_of(branch.elements)
        nodes = nodes[~eliminated[nodes]]
        branch.border = nodes[np.argsort(place[nodes])]
    return part.branches


class _Dissection:
    def __init__(self, elements: Ints, centres_mm: Floats, free: NDArray[np.bool_]) -> None:
        self.elements, self.free = elements, free
        columns = [np.unique(x, return_inverse=True)[1] for x in np.round(centres_mm, 3).T]
        self.ranks = np.stack(columns, -1)
        self.open = free.copy()
        self.low, self.high = np.zeros((2, len(free)), np.int64)
        self.branches: list[Branch] = []

    def nodes_of(self, some: Ints) -> Ints:
        nodes = np.unique(self.elements[some])
        return nodes[self.free[nodes]]

    def divide(self, some: Ints) -> int:
        """Append the branches of these elements; returns the number of the last."""
        halves = self._halves(some) if len(some) > _LEAF else None
        if halves is None:
            nodes = self.nodes_of(some)
            pivots = nodes[self.open[nodes]]
            self.open[pivots] = False
            self.branches.append(Branch([], some, pivots))
        else:
            left, right, shared = halves
            self.open[shared] = False
            children = [self.divide(left), self.divide(right)]
            self.branches.append(Branch(children, some[:0], shared))
        return len(self.branches) - 1

    def _halves(self, some: Ints) -> tuple[Ints, Ints, Ints] | None:
        axis, rank = cheapest_cut(self.elements, self.ranks, some, self.open, self.free, self.low, self.high)
        if axis < 0:
            return None
        on_left = self.ranks[some, axis] <= rank
        left, right = some[on_left], some[~on_left]
        shared = self.open.copy()
        for half in (left, right):
            here = np.zeros_like(shared)
            here[self.elements[half]] = True
            shared &= here
        return left, right, np.nonzero(shared)[0]


@njit(cache=True, nogil=True)
def cheapest_cut(elements, ranks, some, open_nodes, free, low, high):  # type: ignore[no-untyped-def]
    """The axis and the last rank on its left side of the cut through some elements that seems to cost least.

    `ranks` (M, 3) are the elements' places along the axes; -1, -1 if no cut parts them. What a cut costs is
    the elimination of the nodes it goes through, and a guess at either half's. `low` and `high` (N,) are
    scratch.
    """
    best, best_axis, best_rank = np.inf, -1, -1
    for axis in range(3):
        places = 0
        for e in some:
            places = max(places, ranks[e, axis] + 1)
            for n in elements[e]:
                low[n] = len(elements)
                high[n] = -1
        count = np.zeros(places, np.int64)
        for e in some:
            rank = ranks[e, axis]
            count[rank] += 1
            for n in elements[e]:
                low[n] = min(low[n], rank)
                high[n] = max(high[n], rank)
        # Cut after cut: how the nodes in it, and the border's to its left and right, grow in number.
        shared, left, right = np.zeros((3, places), np.int64)
        border = 0
        for e in some:
            for n in elements[e]:
                if high[n] < 0 or not free[n]:
                    continue
                if open_nodes[n]:
                    shared[low[n]] += 1
                    shared[high[n]] -= 1
                else:
                    border += 1
                    left[low[n]] += 1
                    right[high[n]] -= 1
                high[n] = -1  # seen
        half, cut, border_left, border_right = 0, 0, 0, border
        for rank in range(places):
            half += count[rank]
            cut += shared[rank]
            border_left += left[rank]
            border_right += right[rank]
            if count[rank] > 0 and half < len(some):
                p, n = 3.0 * cut, 3.0 * (cut + border)
                cost = p * n * n - p * p * n + p**3 / 3
                cost += _guess(half, 3.0 * (cut + border_left))
                cost += _guess(len(some) - half, 3.0 * (cut + border_right))
                if cost < best:
                    best, best_axis, best_rank = cost, axis, rank
    return best_axis, best_rank


@njit(cache=True, nogil=True, inline="always")
def _guess(count, border):  # type: ignore[no-untyped-def]
    """About what it costs to eliminate `count` elements inside a border of so many unknowns.

    As if a quarter of their 24 unknowns each were eliminated from fronts of the border and one more cut.
    """
    return 6.0 * count * (border + _SIDE * count ** (2 / 3)) ** 2
