"""One case on one geometry: press, slide from position to position, read the sensors.

Units: mm, kPa, N/m.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.checks import fault, inside_out
from palpate.sim.tissue.contact import Contact
from palpate.sim.tissue.errors import CaseError, StrokeError
from palpate.sim.tissue.geometry import Geometry
from palpate.sim.tissue.material import Tissue, elasticity
from palpate.sim.tissue.newton import Equilibrium, Newton, NoConvergence
from palpate.sim.tissue.predictor import Predictor
from palpate.sim.tissue.probe_shape import ProbeShape
from palpate.sim.tissue.reading import Reading
from palpate.sim.tissue.reference import ReferenceNewton
from palpate.sim.tissue.result import Stroke
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.state import State

Floats = NDArray[np.float64]

_HALVINGS = 6
_LEAST_SHARE = 1e-3
_FINE_START = 0.5
"""Part of the expected depth at which Newton starts on a fine mesh: from deeper the first steps overshoot."""


class StrokeRun:
    """One case on one geometry."""

    def __init__(self, case: Case, settings: Settings, geometry: Geometry) -> None:
        self.case, self.mesh, self.fine = case, geometry.mesh, settings.fine
        self.surface_mm = geometry.mesh.border_mm + case.t_mm
        self.areas = geometry.integrals.dx.sum(1)
        self.tissue = Tissue(geometry.mesh, geometry.integrals, elasticity(case, geometry.mesh))
        shape = ProbeShape(case.probe_radius_mm, case.face_half_mm, case.fillet_per_mm2)
        padding = case.padding_mm_per_kPa
        if padding and settings.solver == "reference":
            raise CaseError(f"{case.code}: the reference solver knows bare faces only")
        self.contact = Contact(geometry.mesh, shape, case.friction, padding_mm_per_kPa=padding)
        # under a padding the pressure ends in a straight line
        self.reading = Reading(self.contact.x0, settings.to_border and not padding)
        self.newton: Equilibrium = (
            ReferenceNewton(self.mesh, self.tissue.constants, shape, case.friction, settings.tolerance)
            if settings.solver == "reference"
            else Newton(self.tissue, self.contact, geometry.solver, settings.tolerance, settings.fine)
        )
        self.predictor = Predictor(geometry.mesh, self.areas)

    def press(self, position: float, pressed: State | None) -> State:
        """The state at the first position, reached from `pressed` or from nothing by raising the force."""
        state = self._press(position, pressed)
        if state.smallest_jacobian <= 0.0:  # a balance, but not one that tissue gets into
            state = self._creep(self._unloaded(0.1), position, 0.0)
        return state

    def _press(self, position: float, pressed: State | None) -> State:
        if pressed is not None:
            return self._raise_force(pressed, position, self.case.F_N_per_m / 2)
        depth = self._expected_depth() * (_FINE_START if self.fine else 1.0)
        try:
            return self.newton.solve(self._unloaded(depth), position, self.case.F_N_per_m, 15)
        except NoConvergence:
            return self._raise_force(self._unloaded(0.1), position, 0.0)

    def _unloaded(self, depth: float) -> State:
        """Undeformed tissue, the probe `depth` below its surface."""
        rest, pressure = np.zeros(2 * len(self.mesh.nodes_mm)), np.zeros((len(self.areas), 3))
        return State(rest, self.surface_mm - depth, np.zeros(len(self.mesh.surface)), pressure)

    def _expected_depth(self) -> float:
        """Displacement far from the lump as the regressions of the thesis' runs have it, F^.62 t^.67."""
        force = self.case.F_N_per_m / (10.0 * self.case.fat_kPa)
        return min(2.56 * force**0.62 * (self.case.t_mm / 13.0) ** 0.67, 0.3 * self.case.t_mm)

    def _raise_force(self, state: State, position: float, done: float) -> State:
        """Raise the force from `done`, in smaller steps where it does not converge."""
        start, begun, goal, failures = state, done, self.case.F_N_per_m, 0
        target = 0.35 * goal if done == 0.0 else goal
        while done < goal:
            try:
                state, done = self.newton.solve(state, position, target, careful=failures > 0), target
                target = goal
            except NoConvergence:
                failures += 1
                target = done + (target - done) / 3
                if failures > _HALVINGS:
                    return self._creep(start, position, begun)
        return state

    def _creep(self, state: State, position: float, done: float) -> State:
        """Raise the force from `done` in steps that grow slowly: for faces so sharp that larger ones fail."""
        goal = self.case.F_N_per_m
        step = goal / 20
        while done < goal:
            target = min(done + step, goal)
            try:
                state, done = self.newton.solve(state, position, target, careful=True), target
                step *= 1.5
            except NoConvergence as error:
                step /= 3
                if step < _LEAST_SHARE * goal:
                    raise StrokeError(self.case.code, position, f"pressing, {error}") from None
        return state

    def _slide(self, history: list[tuple[float, State]], new: float) -> None:
        """Add the state at `new` to `history`; what does not converge is done in halves."""
        force, reason = self.case.F_N_per_m, NoConvergence()
        for recent, careful in ((history[-3:], False), (history[-1:], True)):
            try:
                state = self.newton.solve(self.predictor(recent, new), new, force, careful=careful)
                if state.smallest_jacobian <= 0.0:
                    raise NoConvergence(inside_out(state))
                history.append((new, state))
                return
            except NoConvergence as error:
                reason = error
        old = history[-1][0]
        if new - old < 2.0 / 2**_HALVINGS:
            raise StrokeError(self.case.code, new, f"sliding, {reason}")
        self._slide(history, (old + new) / 2)
        self._slide(history, new)

    def stroke(
        self,
        positions: Floats,
        state: State,
        began: float,
        visit: Callable[[StrokeRun, float, State], None] | None = None,
    ) -> Stroke:
        """Slide through all positions and collect what the probe feels; `visit` is told of every state."""
        rows, iterations, before = [], [], 0
        history = [(float(positions[0]), state)]
        for i, position in enumerate(positions):
            if i:
                self._slide(history, float(position))
                state = history[-1][1]
            elif self.case.friction:
                state = self.newton.solve(state, float(position), self.case.F_N_per_m)
                history = [(float(position), state)]
            iterations.append(self.newton.counts.iterations - before)
            before = self.newton.counts.iterations
            rows.append(self.read(state, float(position)))
            if visit is not None:
                visit(self, float(position), state)
        columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        return Stroke(
            case=self.case,
            positions_mm=positions,
            **columns,
            iterations=np.array(iterations),
            factorisations=self.newton.counts.factorisations,
            nodes=len(self.mesh.nodes_mm),
            cpu_s=time.thread_time() - began,
        )

    def read(self, state: State, position: float) -> dict[str, Any]:
        """What the probe feels, checked: a wrong equilibrium must not pass for a result."""
        x, pressure, force = self.contact.pressure(state.u, state.multiplier, position)
        s = x - position
        touching = np.nonzero(pressure > 0)[0]
        peak = int(pressure.argmax())
        row = {
            "displacement_mm": self.surface_mm - state.height,
            "images_kPa": self.reading(s, pressure),
            "peak_mm": s[peak],
            "peak_kPa": pressure[peak],
            "contact_mm": s[touching[[0, -1]]],
            "force_error": force / self.case.F_N_per_m - 1.0,
            "smallest_jacobian": state.smallest_jacobian,
        }
        own_fat = self.case.fat_mm is not None  # which may be thin, over a gland that yields
        whole = sum(layer.mm for layer in self.case.layers)
        deepest = (whole, "tissue") if own_fat else (self.case.t_mm, "fat")
        if trouble := fault(row, state, *deepest):
            raise StrokeError(self.case.code, position, trouble)
        return row
