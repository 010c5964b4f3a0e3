"""Newton's method for one position of the probe, under a given force.

The multipliers of the active nodes are eliminated with a large stiffness (the constraint stays exact) and
the probe's height is one bordered unknown. The residual is always exact; the tangent is renewed where it
has changed, round the probe, and only when the iteration asks for it. Units: mm, kPa, N/m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue import contact_kernels as kernels
from palpate.sim.tissue.contact import Contact, ContactState
from palpate.sim.tissue.material import Tissue
from palpate.sim.tissue.solver.linear import LinearSolver, NotPositiveDefinite
from palpate.sim.tissue.state import State

Floats = NDArray[np.float64]

_GAP_TOLERANCE_MM = 1e-4
_FORCE_TOLERANCE = 1e-7
_VOLUME_SLACK = 30.0
"""The bulk modulus magnifies what is left of the volume change: true forces may be so much farther off."""

_LARGEST_RISE_MM = 1.5
_WINDOW_MM, _SPARING_MM = 22.0, 18.0
"""The tangent of elements farther from the probe is renewed only if the iteration goes badly; on a fine mesh,
which has the second window, only if it does so twice."""

_GOOD_PROGRESS, _SPARING_PROGRESS = 0.2, 0.5
"""While each step leaves less of the error than this, the tangent may stay; on a fine mesh the second."""


class NoConvergence(ArithmeticError):
    """Newton's iteration did not settle; the text is the reason."""


@dataclass
class Work:
    """What the work consisted of."""

    iterations: int = 0
    tangents: int = 0
    factorisations: int = 0


class Equilibrium(Protocol):
    """What finds the state under a given force: `Newton`, and `reference.ReferenceNewton`."""

    counts: Work

    def solve(
        self, start: State, position: float, force: float, limit: int = 30, careful: bool = False
    ) -> State:
        """See `Newton.solve`."""


class Newton:
    """Finds equilibria of `tissue` under `contact`.

    Parameters
    ----------
    tissue, contact, solver
        The body, the probe's face on it and the linear solver of its mesh.
    tolerance : float
        Largest nodal imbalance, as a fraction of the force.
    sparing : bool
        Renew the tangent near the probe only, while it is still far from bearing the force and where the
        iteration goes badly for the first time: as many iterations, half the work of each.
    """

    def __init__(
        self, tissue: Tissue, contact: Contact, solver: LinearSolver, tolerance: float, sparing: bool = False
    ) -> None:
        self.tissue, self.contact, self.solver, self.tolerance = tissue, contact, solver, tolerance
        self.sparing = sparing
        self._window_mm = _SPARING_MM if sparing else _WINDOW_MM
        self._good = _SPARING_PROGRESS if sparing else _GOOD_PROGRESS
        self.counts = Work()
        mesh = tissue.mesh
        self._held = np.nonzero(mesh.fixed.ravel())[0]
        self._middle_mm = mesh.nodes_mm[mesh.elements[:, 4], 0]
        self._all = np.arange(len(mesh.elements))
        self._stiffness = np.empty((len(mesh.elements), 18, 18))
        self._frozen = np.zeros((len(mesh.elements), 3, 18))
        self._sides = np.zeros(
            (2, mesh.fixed.size)
        )  # right-hand sides: of the step, and of the probe's height
        self._started = False

    def solve(
        self, start: State, position: float, force: float, limit: int = 30, careful: bool = False
    ) -> State:
        """Equilibrium at `position` under `force`, from the guess `start`, which is left as it is.

        Parameters
        ----------
        limit : int
            Most iterations.
        careful : bool
            Renew the whole tangent in every iteration.

        Raises
        ------
        NoConvergence
            It did not settle within `limit` iterations, or diverged.
        """
        state = start.copy()
        touching_before: ContactState | None = None
        error, nearest = np.inf, self.sparing
        for _ in range(limit):
            touching = self.contact.evaluate(state.u, state.multiplier, state.height, position)
            internal, mixed, theta = self.tissue.residual(state.u, state.pressure, self._frozen)
            true = self.contact.balance(touching, self._held, internal.copy())
            largest = self.contact.balance(touching, self._held, mixed)
            force_deficit = force - self.contact.vertical_force(touching)
            error_before, error = error, max(largest, abs(force_deficit)) / force
            gap = np.abs(touching.gap).max() if len(touching.active) else 1.0
            if (
                error < self.tolerance
                and true < _VOLUME_SLACK * self.tolerance * force
                and abs(force_deficit) < _FORCE_TOLERANCE * force
                and gap < _GAP_TOLERANCE_MM
            ):
                state.smallest_jacobian = self.tissue.smallest_jacobian(state.u)
                return state
            if not error < 1e6:
                raise NoConvergence("the iteration diverged")
            slow = error > self._good * error_before
            far = error > 1.0
            if careful or not self._started or (far and not self.sparing):
                self._factor(state, touching, position, self._all)
            elif far or touching_before is None:
                self._factor(state, touching, position, self._near(position))
            elif slow:
                self._factor(state, touching, position, self._near(position) if nearest else self._all)
                nearest = False
            elif not np.array_equal(touching.active, touching_before.active):
                self._factor(state, touching, position, self._all[:0])
            else:
                touching = replace(touching, slope=touching_before.slope)
            fresh = touching_before is None or touching.slope is not touching_before.slope
            if fresh:  # the tangent may have changed, and with it the mixed method's right-hand side
                mixed = self.tissue.mixed(internal, self._frozen)
                self.contact.balance(touching, self._held, mixed)
            self._step(state, touching, mixed, theta, force_deficit, fresh)
            touching_before = touching
            self.counts.iterations += 1
        raise NoConvergence(f"no equilibrium within {limit} iterations (still {error:.1e} of the force out)")

    def linearise(self, state: State, position: float) -> ContactState:
        """Factor the whole tangent at an equilibrium, for its derivatives; what touches there.

        Raises
        ------
        NoConvergence
            The equilibrium is not stable.
        """
        touching = self.contact.evaluate(state.u, state.multiplier.copy(), state.height, position)
        theta = self.tissue.residual(state.u, state.pressure, self._frozen)[2]
        own = State(state.u, state.height, state.multiplier, self.tissue.constants.bulk[:, None] * theta)
        self._factor(own, touching, position, self._all)
        if not self._started:
            raise NoConvergence("the equilibrium is not stable")
        return touching

    def _near(self, position: float) -> NDArray[np.int64]:
        return np.nonzero(np.abs(self._middle_mm - position) < self._window_mm)[0]

    def _factor(
        self, state: State, touching: ContactState, position: float, which: NDArray[np.int64]
    ) -> None:
        self.counts.factorisations += 1
        self.counts.tangents += len(which) > 0
        K = self._stiffness
        try:
            self.tissue.tangent(state.u, state.pressure, which, K, self._frozen)
            self.solver.change(K, which)
            self.solver.factor(self.contact.stiffness(touching), position)
            self._started = True
        except NotPositiveDefinite:
            # Far from equilibrium the pressure's geometric term can destroy definiteness; go on without.
            self._started = False
            try:
                self.tissue.tangent(state.u, np.zeros_like(state.pressure), self._all, K, self._frozen)
                self.solver.change(K, self._all)
                self.solver.factor(self.contact.stiffness(touching, curved=False), position)
            except NotPositiveDefinite:
                raise NoConvergence("the tissue has buckled") from None

    def _step(
        self,
        state: State,
        touching: ContactState,
        residual: Floats,
        theta: Floats,
        force_deficit: float,
        fresh: bool,
    ) -> None:
        contact, border = self.contact, self._sides[1]
        pull, weight = kernels.sides(
            residual, contact.x_dof, touching.active, contact.weight, touching.gap, touching.slope,
            contact.augmentation, fresh, self._sides,
        )  # fmt: skip
        if fresh:
            change, self._border_change = self.solver.solve(self._sides)
            self._pivot = contact.augmentation * weight.sum() - border @ self._border_change
        else:
            change = self.solver.solve(self._sides[:1])[0]
        if len(weight):
            rise = (float(weight @ pull) - force_deficit - border @ change) / self._pivot
        else:
            rise = -0.2  # not touching yet: let the probe sink
        scale = min(1.0, _LARGEST_RISE_MM / max(abs(rise), 1e-12))
        kernels.advance(
            change, self._border_change, rise, scale, contact.x_dof, touching.active, touching.slope,
            pull, contact.augmentation, state.multiplier, state.u,
        )  # fmt: skip
        state.pressure = self.tissue.pressure(change, theta, self._frozen)
        state.height += scale * rise
