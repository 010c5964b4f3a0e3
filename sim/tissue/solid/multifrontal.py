"""Cholesky's factorisation of the solid tangent: single precision, front by front, renewed where it has
changed.

The residual stays in double precision, so the equilibrium's digits do not depend on the factor's; but a
factor in single precision takes half of the time and memory. Fronts over which nothing has changed are
kept. Of the elements' stiffnesses only those of the fronts in work are ever held.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numba.extending import get_cython_function_address
from numpy.typing import NDArray

from palpate.sim.tissue.solid.front_factor import factor_fronts, spread
from palpate.sim.tissue.solid.front_solve import substitute
from palpate.sim.tissue.solid.fronts import Fronts, starts
from palpate.sim.tissue.solver.linear import NotPositiveDefinite

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Singles = NDArray[np.float32]

MOST_SIDES = 128
"""Right-hand sides that are solved for together."""

_BATCH = 64
"""Elements whose stiffnesses are held at a time."""


class _Spare(threading.local):
    """Memory of the thread's last factor, for its next: new memory is cleared first, a tenth of a stroke."""

    def __init__(self) -> None:
        self.arrays: dict[str, Singles] = {}

    def take(self, name: str, size: int) -> Singles:
        """An array of at least `size` numbers."""
        array = self.arrays.pop(name, None)
        if array is None or len(array) < size:
            array = np.empty(size + size // 4, np.float32)  # what is never written to takes no memory
        return array


_spare = _Spare()


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
        self._panels = self._corners = self._rests = np.empty(0, np.float32)
        self._sides = np.empty(int(fronts.size.max()) * MOST_SIDES, np.float32)
        self._dirty = np.ones(len(rest), np.bool_)
        self._every = np.arange(len(rest))
        self._same = np.arange(fronts.dofs.max() + 1)

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
        if not len(self._panels):
            self._take_memory()
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

    def _take_memory(self) -> None:
        sizes = (self.fronts.panel_start[-1], self.fronts.corners, self._rest_start[-1])
        names = ("panels", "corners", "rests")
        arrays = [_spare.take(name, int(size)) for name, size in zip(names, sizes)]
        self._panels, self._corners, self._rests = arrays
        weakref.finalize(self, _spare.arrays.update, zip(names, arrays))

    def solve(self, sides: Floats | Singles) -> Floats:
        """Solutions (n, 3N) for right-hand sides (n, 3N); what is held stays as it is."""
        out = np.empty(sides.shape)
        for first in range(0, len(out), MOST_SIDES):
            out[first : first + MOST_SIDES] = self.back(self.forwards(sides[first : first + MOST_SIDES]))
        return out

    def forwards(self, sides: Floats | Singles) -> Singles:
        """The first half of `solve`, for at most `MOST_SIDES`: (3N, n), a column for each side."""
        columns = np.array(sides.T, np.float32, order="C")
        self._substitute(False, self._every, self._same, columns)
        return columns

    def back(self, columns: Singles) -> Floats:
        """The second half of `solve`: solutions (n, 3N) from `columns` (3N, n), which are lost."""
        self._substitute(True, self._every, self._same, columns)
        return columns.T.astype(np.float64)

    def reach(self, surface: Ints, forces: Floats) -> tuple[Ints, Singles]:
        """What forces on single nodes of the surface come to in `forwards`, each by itself.

        Parameters
        ----------
        surface, forces : ndarray (n,), (n, 3)
            The nodes, by their numbers among those of the surface, and the forces.

        Returns
        -------
        unknowns : ndarray (m,)
            Those that the forces reach: of the fronts over the nodes, and no others.
        columns : ndarray (m, n)
        """
        f = self.fronts
        own = f.front_of_contact[surface]
        on_way = np.zeros(len(f.parent), np.bool_)
        on_way[own] = True
        for front in range(len(on_way) - 1):
            on_way[f.parent[front]] |= on_way[front]
        which = np.nonzero(on_way)[0]
        parts = [f.dofs[f.dofs_start[k] : f.dofs_start[k] + f.pivots[k]] for k in which]
        unknowns = np.sort(np.concatenate(parts)) if parts else np.empty(0, np.int64)
        row = np.full(len(self._same), -1)
        row[unknowns] = np.arange(len(unknowns))
        columns = np.zeros((len(unknowns), len(surface)), np.float32)
        node, axis = np.nonzero(f.contact_rows[surface] >= 0)
        at = f.dofs[f.dofs_start[own[node]] + f.contact_rows[surface[node], axis]]
        columns[row[at], node] = forces[node, axis]
        for first in range(0, len(surface), MOST_SIDES):
            some = np.ascontiguousarray(columns[:, first : first + MOST_SIDES])
            self._substitute(False, which, row, some)
            columns[:, first : first + MOST_SIDES] = some
        return unknowns, columns

    def _substitute(self, back: bool, which: Ints, row: Ints, columns: Singles) -> None:
        f = self.fronts
        substitute(
            back, which, f.size, f.pivots, f.panel_start, f.dofs_start, f.dofs, self._panels, row, columns,
            self._sides, *_constants(),
        )  # fmt: skip


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
