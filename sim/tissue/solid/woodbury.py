"""Woodbury's formula: solutions of a system that differs from the factored one by a few springs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.solid.multifrontal import Multifrontal

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Singles = NDArray[np.float32]


class ContactUpdate:
    """What nodes in or out of contact since a factorisation change in its solutions.

    It works halfway, between forward and back substitution, where a force on a node has reached the fronts
    over it only: a fraction of a whole solution's work and memory.

    Parameters
    ----------
    solver : Multifrontal
        Holds the factor; one that is renewed wants a new correction.

    Attributes
    ----------
    changed : ndarray (n,)
        The nodes that are corrected for, by their numbers among those of the surface.
    """

    def __init__(self, solver: Multifrontal) -> None:
        self._solver = solver
        self._known = np.empty(0, np.int64)
        self._blocks: list[tuple[Ints, Singles]] = []
        self._compliance: Floats = np.empty((0, 0))
        self._inverse: Floats = np.empty((0, 0))
        self._at = self._known
        self.changed = self._known

    def unknown(self, nodes: Ints) -> Ints:
        """Those of these nodes that it was never told of."""
        return np.setdiff1d(nodes, self._known)

    def correct(self, changed: Ints, normals: Floats, stiffness: Floats) -> None:
        """Correct for nodes held along `normals` (n, 3), whose contact adds `stiffness` (n,), less than 0
        where they have left; a node's normal stays what it was when it was first told."""
        new = np.isin(changed, self._known, invert=True)
        if new.any():
            self._learn(changed[new], normals[new])
        order = np.argsort(self._known)
        self._at = order[np.searchsorted(self._known, changed, sorter=order)]
        self.changed = changed
        compliance = self._compliance[np.ix_(self._at, self._at)]
        self._inverse = np.asarray(np.linalg.inv(np.diag(1 / stiffness) + compliance), np.float64)

    def _learn(self, nodes: Ints, normals: Floats) -> None:
        reached, columns = self._solver.reach(nodes, normals)
        across: list[Floats] = [np.empty((0, len(nodes)))]
        for at, others in self._blocks:
            _, theirs, ours = np.intersect1d(at, reached, assume_unique=True, return_indices=True)
            across.append((others[theirs].T @ columns[ours]).astype(np.float64))
        between = np.concatenate(across)
        self._compliance = np.asarray(
            np.block([[self._compliance, between], [between.T, columns.T @ columns]]), np.float64
        )
        self._known = np.concatenate([self._known, nodes])
        self._blocks.append((reached, columns))

    def apply(self, halves: Singles) -> Singles:
        """Right-hand sides (3N, k) of the factored system after forward substitution, corrected in place."""
        seen = np.concatenate([columns.T @ halves[at] for at, columns in self._blocks])
        pull = np.zeros_like(seen)
        pull[self._at] = self._inverse @ seen[self._at]
        first = 0
        for at, columns in self._blocks:
            halves[at] -= columns @ pull[first : first + columns.shape[1]]
            first += columns.shape[1]
        return halves
