"""Whole strokes by our own factorisations and by CHOLMOD: python -m tests.benchmarks.bench_solvers

CPU seconds on one thread, medians of rounds by turns. CHOLMOD is cvxopt's, which is GPL; over solid lumps it
is given our order of elimination, since its own (AMD) fills more.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from functools import partial
from typing import Any
from unittest.mock import patch

import cvxopt
import numpy as np
from cvxopt import cholmod

from palpate.sim.tissue import Case, Settings, Stroke, simulate
from palpate.sim.tissue.geometry import forget_geometries
from palpate.sim.tissue.solid import newton, run
from palpate.sim.tissue.solid.fronts import Fronts
from palpate.sim.tissue.solid.multifrontal import Multifrontal
from palpate.sim.tissue.solid.stroke import forget_geometry
from palpate.sim.tissue.solver.linear import NotPositiveDefinite

PLANE, SOLID = "d10h08e10f10", "d10h08e10f07_ball"
ROUNDS = 3
_LOWER, _UPPER, _PERMUTED, _PERMUTED_BACK = 4, 5, 7, 8
"""Of the systems that CHOLMOD solves."""


class SolidCholmod:
    """Members of `Multifrontal`, by CHOLMOD in double precision; every factorisation is a whole one.

    It is quickest with one at each position, since corrections take all of the factor.
    """

    flops = 0.0

    def __init__(self, fronts: Fronts, renewals: object = None) -> None:
        f = fronts
        place = f.dofs_start[f.front_of_element[f.element]][:, None] + f.element_rows
        elements = np.empty_like(place)
        elements[f.element] = np.where(f.element_rows >= 0, f.dofs[place], -1)
        place = f.dofs_start[f.front_of_contact][:, None] + f.contact_rows
        contact = np.where(f.contact_rows >= 0, f.dofs[np.minimum(place, len(f.dofs) - 1)], -1)
        first = f.dofs_start[:-1]
        self._order = np.concatenate([f.dofs[s : s + n] for s, n in zip(first, f.pivots, strict=True)])
        number = np.full(self._order.max() + 2, -1)
        number[self._order] = np.arange(len(self._order))
        self._size = len(self._order)
        self._skin = number[contact]
        pairs = [_pairs(number[elements]), _pairs(number[contact])]
        self._used = [row >= 0 for row, _ in pairs]
        keys = [
            c[u].astype(np.int64) * self._size + r[u] for (r, c), u in zip(pairs, self._used, strict=True)
        ]
        pattern, self._place = np.unique(np.concatenate(keys), return_inverse=True)
        rows, columns = pattern % self._size, pattern // self._size
        entries = cvxopt.matrix(np.ones(len(pattern)))
        self._matrix = cvxopt.spmatrix(entries, rows.tolist(), columns.tolist(), (self._size, self._size))
        cholmod.options["supernodal"] = 2
        order = cvxopt.matrix(list(range(self._size)))
        self._factor = cholmod.symbolic(self._matrix, p=order, uplo="L")
        self._contact = np.zeros((len(contact), 3, 3))
        self._K = np.empty((len(elements), 81, 81), np.float32)
        self._changed = np.ones(len(elements), bool)

    def change_elements(self, which: Any) -> None:
        """See `Multifrontal.change_elements`."""
        self._changed[which] = True

    def change_contact(self, blocks: Any) -> None:
        """See `Multifrontal.change_contact`."""
        self._contact = blocks

    def factor(self, fill: Callable[[Any, Any], None]) -> None:
        """See `Multifrontal.factor`."""
        changed = np.nonzero(self._changed)[0]
        some = np.empty((len(changed), 81, 81), np.float32)
        fill(changed, some)
        self._K[changed] = some
        self._changed[:] = False
        parts = [M[:, *np.triu_indices(M.shape[1])][u] for M, u in zip((self._K, self._contact), self._used)]
        self._matrix.V = cvxopt.matrix(np.bincount(self._place, np.concatenate(parts)))
        try:
            cholmod.numeric(self._matrix, self._factor)
        except ArithmeticError:
            raise NotPositiveDefinite from None

    def forwards(self, sides: Any) -> Any:
        """See `Multifrontal.forwards`."""
        self._unknowns = sides.shape[1]
        return self._through(np.ascontiguousarray(sides[:, self._order].T), _PERMUTED, _LOWER)

    def back(self, columns: Any) -> Any:
        """See `Multifrontal.back`."""
        out = np.zeros((columns.shape[1], self._unknowns))
        out[:, self._order] = self._through(columns, _UPPER, _PERMUTED_BACK).T
        return out

    def reach(self, surface: Any, forces: Any) -> Any:
        """See `Multifrontal.reach`; here each force reaches all unknowns."""
        columns = np.zeros((self._size, len(surface)))
        node, axis = np.nonzero(self._skin[surface] >= 0)
        columns[self._skin[surface[node], axis], node] = forces[node, axis]
        return np.arange(self._size), self._through(columns, _PERMUTED, _LOWER)

    def _through(self, columns: Any, *systems: int) -> Any:
        x = cvxopt.matrix(columns)
        for system in systems:
            cholmod.solve(self._factor, x, sys=system)
        return np.array(x)


def _pairs(numbers: Any) -> tuple[Any, Any]:
    """Row and column in the lower triangle of each entry of the upper ones; row -1 where it is held."""
    i, j = np.triu_indices(numbers.shape[1])
    a, b = numbers[:, i], numbers[:, j]
    held = (a < 0) | (b < 0)
    return np.where(held, -1, np.maximum(a, b)), np.where(held, -1, np.minimum(a, b))


def plane(solver: str, hx_mm: float) -> Stroke:
    """One stroke over a cylinder, its geometry laid anew."""
    forget_geometries()
    return simulate(Case.from_code(PLANE), Settings(hx_mm=hx_mm, solver=solver))


def solid(solver: Any, reach_mm: float = newton.REACH_MM, most_changes: int = newton.MOST_CHANGES) -> Stroke:
    """One stroke over a ball, its geometry laid anew; how far a factor serves is as of `newton`."""
    forget_geometry()
    policy = patch.multiple(newton, REACH_MM=reach_mm, MOST_CHANGES=most_changes)
    with patch.object(run, "Multifrontal", solver), policy:
        return simulate(Case.from_code(SOLID), Settings())


def race(name: str, other: str, ours: Callable[[], Stroke], theirs: Callable[[], Stroke]) -> None:
    """One row of the table."""
    a, b = ours(), theirs()  # compiled now
    apart = float(np.abs(a.displacement_mm / b.displacement_mm - 1).max())
    times = [(ours().cpu_s, theirs().cpu_s) for _ in range(ROUNDS)]
    own, foreign = (statistics.median(column) for column in zip(*times, strict=True))
    ratio = statistics.median(y / x for x, y in times)
    print(f"| {name} | {other} | {own:.2f} s | {foreign:.2f} s | {ratio:.2f} | {apart:.0e} |", flush=True)


def main() -> None:
    heads = ("stroke", "other solver", "ours", "the other's", "ratio", "displacements differ by")
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for hx_mm in (2.0, 1.0):
        words = f"{PLANE}, columns of {hx_mm:g} mm"
        for name, solver in (("CHOLMOD", "cholmod"), ("SuperLU", "superlu")):
            race(words, name, partial(plane, "strip", hx_mm), partial(plane, solver, hx_mm))
    race(
        SOLID,
        "CHOLMOD",
        lambda: solid(Multifrontal),
        lambda: solid(SolidCholmod, reach_mm=1.0, most_changes=40),
    )


if __name__ == "__main__":
    main()
