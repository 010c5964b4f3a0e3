"""What Newton's method asks of a solver for the tangent: `strip.py` and `sparse.py` offer it."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class NotPositiveDefinite(ArithmeticError):
    """The tangent has no Cholesky factor."""


class LinearSolver(Protocol):
    """Factor, solve many times, change a part, factor again."""

    def change(self, K: Floats, which: Ints) -> None:
        """Take over the stiffnesses K (M, 18, 18) of the elements `which`.

        Raises
        ------
        NotPositiveDefinite
            An element alone makes a factor impossible.
        """

    def factor(self, contact: Floats, position_mm: float) -> None:
        """Factor the elements' stiffnesses and surface blocks (S, 3) of xx, xy, yy.

        Work may be ordered for changes round `position_mm`.

        Raises
        ------
        NotPositiveDefinite
            There is no Cholesky factor.
        """

    def solve(self, B: Floats) -> Floats:
        """Solve for right-hand sides (k, 2N); 0 at held degrees of freedom."""
