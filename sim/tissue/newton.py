"""Newton's method for one position of the probe, under a given force.

The multipliers of the active nodes are eliminated with a large stiffness (the constraint stays exact), the
probe's height is one bordered unknown, and a factor is kept while it serves. Units: mm, kPa, N/m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.tissue.contact import AUGMENTATION, Contact, ContactState
from sim.tissue.linear import LinearSolver, NotPositiveDefinite
from sim.tissue.material import Tissue
from sim.tissue.predictor import State

Floats = NDArray[np.float64]

_GAP_TOLERANCE_MM = 1e-4
_FORCE_TOLERANCE = 1e-7
_LARGEST_RISE_MM = 1.5
_KEEP_FACTOR_BELOW = 3e-2
_KEEP_FACTOR_TIMES = 3


class NoConvergence(ArithmeticError):
    """Newton's iteration did not settle; the text is the reason."""


@dataclass
class Counts:
    """What the work consisted of."""

    iterations: int = 0
    factorisations: int = 0


class Newton:
    """Finds equilibria of `tissue` under `contact`.

    Parameters
    ----------
    tissue, contact, solver
        The body, the probe's face on it and the linear solver of its mesh.
    tolerance : float
        Largest nodal imbalance, as a fraction of the force.
    """

    def __init__(self, tissue: Tissue, contact: Contact, solver: LinearSolver, tolerance: float) -> None:
        self.tissue, self.contact, self.solver, self.tolerance = tissue, contact, solver, tolerance
        self.free = ~tissue.mesh.fixed.ravel()
        self.counts = Counts()

    def solve(self, start: State, position: float, force: float, limit: int = 30, keep: bool = True) -> State:
        """Equilibrium at `position` under `force`, from the guess `start`, which is left as it is.

        Parameters
        ----------
        limit : int
            Most iterations.
        keep : bool
            Whether a factor may serve for more than one step.

        Raises
        ------
        NoConvergence
            It did not settle within `limit` iterations, or diverged.
        """
        state = start.copy()
        factored: ContactState | None = None
        kept = 0
        for _ in range(limit):
            seen = self.contact.evaluate(state.u, state.multiplier, state.height, position)
            inactive = np.ones(len(state.multiplier), bool)
            inactive[seen.active] = False
            state.multiplier[inactive] = 0.0
            residual = self.tissue.residual(state.u)
            self.contact.add_residual(seen, residual)
            residual[~self.free] = 0.0
            lack = force - self.contact.vertical_force(seen)
            error = max(np.abs(residual).max(), abs(lack)) / force
            gap = np.abs(seen.gap).max(initial=0.0) if len(seen.active) else 1.0
            if error < self.tolerance and abs(lack) < _FORCE_TOLERANCE * force and gap < _GAP_TOLERANCE_MM:
                return state
            if not error < 1e6:
                raise NoConvergence("the iteration diverged")
            same = factored is not None and np.array_equal(factored.active, seen.active)
            if keep and same and error < _KEEP_FACTOR_BELOW and kept < _KEEP_FACTOR_TIMES:
                kept += 1
            else:
                self._factor(state, seen)
                factored, kept = seen, 0
            assert factored is not None
            self._step(state, seen, factored.slope, residual, lack, fresh=kept == 0)
            self.counts.iterations += 1
        raise NoConvergence(f"no equilibrium within {limit} iterations (still {error:.1e} of the force out)")

    def _factor(self, state: State, seen: ContactState) -> None:
        self.counts.factorisations += 1
        try:
            K = self.tissue.tangent(state.u, state.pressure)
            self.solver.factor(K, self.contact.stiffness(seen))
        except NotPositiveDefinite:
            # Far from equilibrium the pressure's geometric term can spoil definiteness; go on without.
            K = self.tissue.tangent(state.u, np.zeros_like(state.pressure))
            try:
                self.solver.factor(K, self.contact.stiffness(seen, curved=False))
            except NotPositiveDefinite:
                raise NoConvergence("the tissue has buckled") from None

    def _step(
        self, state: State, seen: ContactState, slope: Floats, residual: Floats, lack: float, fresh: bool
    ) -> None:
        x = self.contact.x_dof[seen.active]
        weight = self.contact.weight[seen.active]
        pull = AUGMENTATION * seen.gap
        right = -residual
        right[x] += weight * pull * slope
        right[x + 1] -= weight * pull
        if fresh:
            border = np.zeros_like(right)
            border[x] = weight * AUGMENTATION * slope
            border[x + 1] = -weight * AUGMENTATION
            both = self.solver.solve(np.stack([right, border], 1))
            change, self._border_change = both[:, 0], both[:, 1]
            self._border = border
            self._pivot = AUGMENTATION * weight.sum() - border @ self._border_change
        else:
            change = self.solver.solve(right[:, None])[:, 0]
        if len(x):
            rise = (float(weight @ pull) - lack - self._border @ change) / self._pivot
        else:
            rise = -0.2  # not touching yet: let the probe sink
        change = change - self._border_change * rise
        scale = min(1.0, _LARGEST_RISE_MM / max(abs(rise), 1e-12))
        moved = change[x + 1] - slope * change[x] - rise
        state.multiplier[seen.active] += scale * (pull + AUGMENTATION * moved)
        change *= scale
        state.pressure = self.tissue.pressure(state.u, change)
        state.u += change
        state.height += scale * rise
