"""Newton's method for one position of the probe over a solid lump, under a given force.

As in the plane (`palpate.sim.tissue.newton`): multipliers eliminated with a large stiffness, the probe's
height one bordered unknown, the mixed right-hand side. A factorisation is what costs here. One serves for a
position, and for the next ones if they are near: nodes that come into contact or leave it meanwhile are
corrected for (Woodbury), and the rim is factored so that it may be let go (`rim.py`).
Units: mm, kPa, mN.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.newton import NoConvergence
from palpate.sim.tissue.solid.body import Body
from palpate.sim.tissue.solid.face import FaceContact, Touching
from palpate.sim.tissue.solid.mesh import SolidMesh
from palpate.sim.tissue.solid.multifrontal import Multifrontal
from palpate.sim.tissue.solid.rim import Rim
from palpate.sim.tissue.solid.woodbury import ContactUpdate
from palpate.sim.tissue.solver.linear import NotPositiveDefinite
from palpate.sim.tissue.state import State

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_GAP_TOLERANCE_MM = 2e-4
_FORCE_TOLERANCE = 1e-7
_NODE_SHARE = 2.0
"""Of the plane's tolerance: a tenth of it takes a third more iterations and moves no pressure by 1e-5 kPa."""

_ROUGH = 1e-3

_LARGEST_RISE_MM = 1.5
WINDOW_MM = 15.0
"""The tangent of elements farther from the probe is renewed only if the iteration goes badly."""

_GOOD_PROGRESS = 0.6
"""While each step leaves less of the error than this, the tangent may stay."""

REACH_MM = 4.1
"""A factor serves positions so near its own."""

_STRICTER = 0.25
"""Of the tolerance, with another position's factor: its last steps gain less."""

_RIM_MM = 6.0
"""The rim's half width: what a face that moves on by the reach leaves, and some of what it pulls along."""

MOST_CHANGES = 300
"""Changes of the active set that are corrected for: more cost as much as a factorisation."""


@dataclass
class SolidWork:
    """What the work consisted of."""

    iterations: int = 0
    factorisations: int = 0
    flops: float = 0.0
    solves: int = 0


def factored(positions: Iterable[float]) -> list[float]:
    """Those of a stroke's positions where it is likely to factor: the others are within reach of them.

    The first position's factor, of a press, serves no other.
    """
    out: list[float] = []
    for position in positions:
        if len(out) < 2 or position - out[-1] > REACH_MM:
            out.append(position)
    return out


def near_probe(mesh: SolidMesh, position: float) -> Ints:
    """Elements whose tangent is renewed with the probe at `position`."""
    return np.nonzero(np.abs(mesh.nodes_mm[mesh.elements, 0].mean(1) - position) < WINDOW_MM)[0]


class SolidNewton:
    """Finds equilibria of a body under a face.

    Parameters
    ----------
    body, contact, solver
        The body, the probe's face on it and the linear solver of its mesh.
    tolerance : float
        Largest nodal imbalance, as a fraction of the force, in the measure of the plane.
    """

    def __init__(self, body: Body, contact: FaceContact, solver: Multifrontal, tolerance: float) -> None:
        self.body, self.contact, self.solver = body, contact, solver
        self.tolerance = _NODE_SHARE * tolerance
        self.counts = SolidWork()
        mesh = body.mesh
        self._held = np.nonzero(mesh.fixed.ravel())[0]
        self._all = np.arange(len(mesh.elements))
        self._frozen = np.zeros((len(mesh.elements), 4, 81))
        self._started = False
        self._slow = 0
        self._factored: Touching | None = None
        self._factored_at_mm = np.inf
        self._reach_mm = 0.0
        self._rim = Rim(mesh, _RIM_MM)
        self._normals: Floats = np.zeros((len(contact.nodes), 3))
        self._correction = ContactUpdate(solver)

    def solve(
        self,
        start: State,
        position: float,
        force: float,
        limit: int = 30,
        careful: bool = False,
        rough: bool = False,
        onwards: bool = False,
    ) -> State:
        """Equilibrium at `position` under `force`, from the guess `start`, which is left as it is.

        Parameters
        ----------
        limit : int
            Most iterations.
        careful : bool
            Renew the whole tangent in every iteration.
        rough : bool
            Three digits will do, for a state that is only a start.
        onwards : bool
            What is factored here is to serve the next positions, too.

        Raises
        ------
        NoConvergence
            It did not settle within `limit` iterations, or diverged.
        """
        state = start.copy()
        if abs(position - self._factored_at_mm) > self._reach_mm:
            self._factored = None
        tolerance = _ROUGH if rough else self.tolerance
        if self._factored is not None and position != self._factored_at_mm:
            tolerance *= _STRICTER
        self._slow = 0
        before: Touching | None = None
        error = np.inf
        for _ in range(limit):
            seen = self.contact.evaluate(state.u, state.multiplier, state.height, position)
            residual, theta = self.body.residual(state.u, state.pressure, self._frozen)
            self._balance(residual, seen)
            force_deficit = force - seen.force.sum()
            error_before, error = error, max(np.abs(residual).max(), 0.05 * abs(force_deficit)) / force
            gap = np.abs(seen.gap).max() if len(seen.active) else 1.0
            if (
                error < tolerance
                and abs(force_deficit) < _FORCE_TOLERANCE * force
                and (rough or gap < _GAP_TOLERANCE_MM)
            ):
                state.smallest_jacobian = self.body.smallest_jacobian(state.u)
                return state
            if not error < 1e4:
                raise NoConvergence("the iteration diverged")
            renew = self._to_renew(seen, error, error_before, position, careful)
            if renew is not None:
                reach_mm = REACH_MM if onwards and position != self._factored_at_mm else 0.0
                self._factor(state, seen, renew, position, reach_mm)
                residual, theta = self.body.residual(state.u, state.pressure, self._frozen)
                self._balance(residual, seen)
            else:
                self._correct(seen)
                seen = replace(seen, normal=self._normals[seen.active])
            fresh = renew is not None or before is None or not np.array_equal(seen.active, before.active)
            self._step(state, seen, residual, theta, force_deficit, fresh)
            before = seen
            self.counts.iterations += 1
        raise NoConvergence(f"no equilibrium within {limit} iterations (still {error:.1e} of the force out)")

    def linearise(self, state: State, position: float) -> Touching:
        """Factor the whole tangent at an equilibrium, for its derivatives; what touches there.

        Raises
        ------
        NoConvergence
            The equilibrium is not stable.
        """
        seen = self.contact.evaluate(state.u, state.multiplier.copy(), state.height, position)
        _, theta = self.body.residual(state.u, state.pressure, self._frozen)
        own = replace(state, pressure=self.body.constants.bulk[:, None] * theta)
        self._factor(own, seen, self._all, position)
        return seen

    def _balance(self, residual: Floats, seen: Touching) -> None:
        self.contact.push(seen, residual)
        residual[self._held] = 0.0

    def _to_renew(
        self, seen: Touching, error: float, error_before: float, position: float, careful: bool
    ) -> Ints | None:
        """Elements whose tangent to renew before the next step; None if the factor may stay."""
        if careful or not self._started or error > 0.5:
            return self._all
        near = near_probe(self.body.mesh, position)
        if self._factored is None:
            return near
        self._slow = self._slow + 1 if error > _GOOD_PROGRESS * error_before else 0
        if self._slow > 1 or error > 3 * error_before:
            # renewing only the window could go on for ever
            return near if position != self._factored_at_mm else self._all
        changes = len(np.setxor1d(seen.active, self._factored.active, assume_unique=True))
        return near if changes > MOST_CHANGES else None

    def _factor(
        self, state: State, seen: Touching, which: Ints, position: float, reach_mm: float = 0.0
    ) -> None:
        """Factor the tangent, so that it serves positions within `reach_mm`, too."""
        solver = self.solver
        pressure = state.pressure.copy()
        if reach_mm > 0.0:
            pressure[self._rim.elements(seen.active)] = 0.0
        try:
            self._renew(state.u, pressure, seen, which, curved=True)
        except NotPositiveDefinite:
            # Far from equilibrium the pressure's geometric term can make the tangent indefinite: omit it.
            try:
                self._renew(state.u, np.zeros_like(state.pressure), seen, self._all, curved=False)
            except NotPositiveDefinite:
                self._started = False
                raise NoConvergence("the tissue has buckled") from None
        self._started = True
        self._factored = seen
        self._correction = ContactUpdate(solver)
        self._factored_at_mm, self._reach_mm = position, reach_mm
        self._normals[seen.active] = seen.normal
        self.counts.flops += solver.flops

    def _renew(self, u: Floats, q: Floats, seen: Touching, which: Ints, curved: bool) -> None:
        self.counts.factorisations += 1
        self.solver.change_elements(which)
        self.solver.change_contact(self.contact.stiffness(seen, curved))
        self.solver.factor(lambda some, K: self.body.tangent(u, q, some, K, self._frozen))

    def _correct(self, seen: Touching) -> None:
        """Prepare the correction for what has come into contact or left it since the factorisation."""
        assert self._factored is not None
        changed = np.setxor1d(seen.active, self._factored.active, assume_unique=True)
        if np.array_equal(self._correction.changed, changed):
            return
        contact = self.contact
        came = np.setdiff1d(changed, self._factored.active, assume_unique=True)
        new = self._correction.unknown(came)
        self._normals[new] = seen.normal[np.searchsorted(seen.active, new)]
        stiffness = contact.augmentation * contact.weight[changed]
        stiffness[np.isin(changed, self._factored.active)] *= -1.0
        self._correction.correct(changed, self._normals[changed], stiffness)
        self.counts.solves += len(changed)

    def _solved(self, sides: Floats) -> Floats:
        self.counts.solves += len(sides)
        halves = self.solver.forwards(sides)
        return self.solver.back(self._correction.apply(halves) if len(self._correction.changed) else halves)

    def _step(
        self, state: State, seen: Touching, residual: Floats, theta: Floats, force_deficit: float, fresh: bool
    ) -> None:
        contact, active = self.contact, seen.active
        weight = contact.weight[active] * contact.augmentation
        pull = contact.augmentation * seen.gap
        right = -residual
        right[contact.dofs[active]] -= (contact.weight[active] * pull)[:, None] * seen.normal
        right[self._held] = 0.0
        sides = right[None]
        if fresh:
            border = np.zeros_like(right)
            border[contact.dofs[active]] = -weight[:, None] * seen.normal
            border[self._held] = 0.0
            self._border = border
            sides = np.stack([right, border])
        solutions = self._solved(sides)
        if fresh:
            self._border_change = solutions[1]
            self._pivot = weight.sum() - self._border @ solutions[1]
        change = solutions[0]
        if len(active):
            rise = (
                float(contact.weight[active] @ pull) - force_deficit - self._border @ change
            ) / self._pivot
        else:
            rise = -0.2  # not touching yet: let the probe sink
        scale = min(1.0, _LARGEST_RISE_MM / max(abs(rise), 1e-12))
        change -= self._border_change * rise
        moved = (seen.normal * change[contact.dofs[active]]).sum(-1) - rise
        state.multiplier[active] += scale * (pull + contact.augmentation * moved)
        pressure = self.body.pressure(change, theta, self._frozen)
        state.pressure += scale * (pressure - state.pressure)
        state.u += scale * change
        state.height += scale * rise
