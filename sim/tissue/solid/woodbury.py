"""Woodbury's formula: solutions of a system that differs from the factored one by a few springs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Singles = NDArray[np.float32]


@dataclass
class ContactUpdate:
    """What n nodes in or out of contact since the factorisation change in its solutions.

    Attributes
    ----------
    changed : ndarray (n,)
        The nodes, by their numbers among those of the surface.
    dofs : ndarray (n, 3)
        Their unknowns.
    normals : ndarray (n, 3)
        The directions in which they are held; 0 where an unknown is fixed.
    columns : ndarray (n, 3N)
        The factored system's solutions for a unit force on each, along its normal.
    inverse : ndarray (n, n)
        Of 1 / stiffness and the nodes' compliance on each other.
    """

    changed: Ints
    dofs: Ints
    normals: Floats
    columns: Floats
    inverse: Floats

    @classmethod
    def of(
        cls,
        changed: Ints,
        dofs: Ints,
        normals: Floats,
        stiffness: Floats,
        size: int,
        solve: Callable[[Singles], Floats],
    ) -> ContactUpdate:
        """Work it out for nodes whose contact adds `stiffness` (n,), less than 0 where they have left.

        Parameters
        ----------
        size : int
            Number of unknowns, 3N.
        solve : callable
            Solutions (n, 3N) of the factored system for right-hand sides (n, 3N).
        """
        sides = np.zeros((len(changed), size), np.float32)  # as the solver has them: there may be forty
        sides[np.arange(len(changed))[:, None], dofs] = normals
        columns = solve(sides)
        compliance = (columns[:, dofs] * normals).sum(-1)  # [i, j]: what node j sees of node i's column
        return cls(changed, dofs, normals, columns, np.linalg.inv(np.diag(1 / stiffness) + compliance.T))

    def apply(self, solutions: Floats) -> Floats:
        """Solutions (m, 3N) of the factored system, corrected."""
        seen = (solutions[:, self.dofs] * self.normals).sum(-1)
        return np.asarray(solutions - seen @ self.inverse.T @ self.columns)
