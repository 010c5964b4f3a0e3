"""Cholesky's factorisation of the solid tangent: single precision, front by front, renewed where it has
changed.

The residual stays in double precision, so the equilibrium's digits do not depend on the factor's; but a
factor in single precision takes half of the time and memory. Fronts over which nothing has changed are
kept. Of the elements' stiffnesses only those of the fronts in work are ever held.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numba.extending import get_cython_function_address
from numpy.typing import NDArray

from palpate.sim.tissue.solid.front_factor import factor_fronts, spread
from palpate.sim.tissue.solid.front_solve import solve_fronts
from palpate.sim.tissue.solid.fronts import Fronts, starts
from palpate.sim.tissue.solver.linear import NotPositiveDefinite

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Singles = NDArray[np.float32]

MOST_SIDES = 64
"""Right-hand sides that are solved for together."""

_BATCH = 64
"""Elements whose stiffnesses are held at a time."""


class Multifrontal:
    """The factor of one mesh's tangent.

    Parameters
    ----------
    fronts : Fronts
        Its layout.
    renewals : sequence of ndarray, optional
        Sets of elements that are likely to be renewed together. What other fronts pass up is kept for these
        only, and worked out again where something else is renewed; by default all of it is kept.
    """

    def __init__(self, fronts: Fronts, renewals: Sequence[Ints] | None = None) -> None:
        self.fronts = fronts
        rest = fronts.size - fronts.pivots
        self._kept = np.ones(len(rest), np.bool_) if renewals is None else self._needed(renewals)
        self._rest_start = starts(np.where(self._kept, rest * (rest + 1) // 2, 0))
        self.contact = np.zeros((len(fronts.contact_rows), 3, 3), np.float32)
        self.flops = 0.0
        self._K = np.empty((max(_BATCH, int(np.diff(fronts.element_start).max())), 81, 81), np.float32)
        self._panels = np.empty(fronts.panel_start[-1], np.float32)
        self._corners = np.empty(fronts.corners, np.float32)
        self._rests = np.empty(self._rest_start[-1], np.float32)
        self._sides = np.empty(int(fronts.size.max()) * MOST_SIDES, np.float32)
        self._dirty = np.ones(len(rest), np.bool_)

    def _needed(self, renewals: Sequence[Ints]) -> NDArray[np.bool_]:
        """Fronts that stay in one of the renewals while their parent changes."""
        parent = self.fronts.parent
        kept = np.zeros(len(parent), np.bool_)
        for which in renewals:
            dirty = np.zeros_like(kept)
            dirty[self.fronts.front_of_element[which]] = True
            spread(dirty, parent, np.ones_like(kept))
            kept |= ~dirty & dirty[parent] & (parent >= 0)
        return kept

    def change_elements(self, which: Ints) -> None:
        """The stiffness of these elements has changed since the last factorisation."""
        self._dirty[self.fronts.front_of_element[which]] = True

    def change_contact(self, blocks: Singles) -> None:
        """The contact adds `blocks` (S, 3, 3) to the tangent."""
        changed = (blocks != self.contact).any((1, 2))
        self._dirty[self.fronts.front_of_contact[changed]] = True
        self.contact = blocks

    def factor(self, fill: Callable[[Ints, Singles], None]) -> None:
        """Factor the tangent.

        Parameters
        ----------
        fill : callable
            Puts the stiffnesses of some elements (n,) into an array (n, 81, 81), upper triangles. It is asked
            for every element of a front that has changed, or has to be worked out again.

        Raises
        ------
        NotPositiveDefinite
            It has no Cholesky factor; everything is to be factored anew.
        """
        f = self.fronts
        spread(self._dirty, f.parent, self._kept)
        self.flops = float(f.work[self._dirty].sum())
        asked = starts(np.where(self._dirty, np.diff(f.element_start), 0))
        first = 0
        while first < len(self._dirty):
            last = max(int(np.searchsorted(asked, asked[first] + _BATCH, "right")) - 1, first + 1)
            own = np.repeat(self._dirty[first:last], np.diff(f.element_start[first : last + 1]))
            which = f.element[f.element_start[first] : f.element_start[last]][own]
            fill(which, self._K[: len(which)])
            good = factor_fronts(
                first, last, self._dirty, self._kept, f.size, f.pivots, f.panel_start, f.corner_start,
                self._rest_start, f.child_start, f.child, f.element_start, f.element_rows, f.up_start, f.up,
                f.run_start, f.run, f.contact_start, f.contact, f.contact_rows, self._K, self.contact,
                self._panels, self._corners, self._rests, *_constants(),
            )  # fmt: skip
            if not good:
                self._dirty[:] = True
                raise NotPositiveDefinite
            first = last
        self._dirty[:] = False

    def solve(self, sides: Floats | Singles) -> Floats:
        """Solutions (n, 3N) for right-hand sides (n, 3N); what is held stays as it is."""
        f = self.fronts
        out = np.array(sides, np.float32)
        for first in range(0, len(out), MOST_SIDES):
            solve_fronts(
                f.size, f.pivots, f.panel_start, f.dofs_start, f.dofs, self._panels,
                out[first : first + MOST_SIDES], self._sides, *_constants(),
            )  # fmt: skip
        return out.astype(np.float64)


_LETTERS = np.frombuffer(b"LRTN", np.uint8).copy()
_NUMBERS = np.array([1.0, -1.0], np.float32)


@cache
def _routines() -> np.ndarray:
    """Addresses of spotrf, strsm, ssyrk, sgemm, strsv and sgemv."""
    blas = [
        get_cython_function_address("scipy.linalg.cython_blas", name)
        for name in ("strsm", "ssyrk", "sgemm", "strsv", "sgemv")
    ]
    return np.array([get_cython_function_address("scipy.linalg.cython_lapack", "spotrf"), *blas], np.int64)


def _constants() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return _routines(), _LETTERS, _NUMBERS
