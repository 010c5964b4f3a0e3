"""Nested dissection of a solid mesh: halves of halves of its elements, parted by the nodes that they
share."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

_LEAF = 8
"""Elements that are eliminated together at the bottom."""

_SHARES = (0.5, 0.4, 0.6)
_LOPSIDED = 0.7
"""A half may not hold more than this share of the elements."""


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
    def __init__(self, elements: Ints, centres: Floats, free: NDArray[np.bool_]) -> None:
        self.elements, self.centres, self.free = elements, np.round(centres, 3), free
        self.open = free.copy()
        self.stamps = np.zeros(len(free), np.int64)
        self.stamp = 0
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
        best: tuple[float, NDArray[np.bool_]] | None = None
        for axis in range(3):
            where = self.centres[some, axis]
            places = np.unique(where)
            if len(places) < 2:
                continue
            for share in _SHARES if len(some) > 60 else _SHARES[:1]:
                k = int(np.searchsorted(places, np.quantile(where, share)))
                k = min(max(k, 1), len(places) - 1)
                left = where < (places[k - 1] + places[k]) / 2
                larger = max(left.mean(), 1 - left.mean())
                cost = self._count(some, left) * (1 + 2 * max(0.0, larger - 0.5))
                cost += 1e6 * (larger > _LOPSIDED)
                if best is None or cost < best[0]:
                    best = cost, left
        if best is None:
            return None
        left = best[1]
        self.stamp += 2
        shared = _shared(self.elements, some, left, self.open, self.stamps, self.stamp)
        return some[left], some[~left], np.sort(shared)

    def _count(self, some: Ints, left: NDArray[np.bool_]) -> int:
        self.stamp += 2
        return len(_shared(self.elements, some, left, self.open, self.stamps, self.stamp))


@njit(cache=True, nogil=True)
def _shared(elements, some, left, open_nodes, stamps, stamp):  # type: ignore[no-untyped-def]
    """Open nodes that elements on both sides have; `stamp` and `stamp` + 1 are marks not used before."""
    for i in range(len(some)):
        if left[i]:
            for n in elements[some[i]]:
                stamps[n] = stamp
    out = np.empty(27 * len(some), np.int64)
    count = 0
    for i in range(len(some)):
        if not left[i]:
            for n in elements[some[i]]:
                if stamps[n] == stamp and open_nodes[n]:
                    stamps[n] = stamp + 1
                    out[count] = n
                    count += 1
    return out[:count].copy()
