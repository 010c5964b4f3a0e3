"""One solid case on one geometry: press, slide from position to position, read the sensors.

Units: mm, kPa, mN (1 mN = 1 kPa mm^2).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.checks import fault, inside_out
from palpate.sim.tissue.errors import StrokeError
from palpate.sim.tissue.face_sensors import ACROSS, SENSORS_MM, places_mm
from palpate.sim.tissue.newton import NoConvergence
from palpate.sim.tissue.probe_shape import ProbeShape
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.solid.body import Body
from palpate.sim.tissue.solid.element import SolidIntegrals, elasticity, integrate
from palpate.sim.tissue.solid.face import FaceContact, FaceShape
from palpate.sim.tissue.solid.fronts import Fronts, lay_fronts
from palpate.sim.tissue.solid.grid import SolidGrid
from palpate.sim.tissue.solid.mesh import SolidMesh, build_mesh
from palpate.sim.tissue.solid.multifrontal import Multifrontal
from palpate.sim.tissue.solid.newton import SolidNewton, factored, near_probe
from palpate.sim.tissue.solid.predictor import SolidPredictor
from palpate.sim.tissue.state import State

Floats = NDArray[np.float64]

_HALVINGS = 6
_LEAST_SHARE = 1e-3


@dataclass(frozen=True)
class SolidGeometry:
    """What cases of the same shape share: mesh, integrals, the solver's analysis."""

    mesh: SolidMesh
    integrals: SolidIntegrals
    fronts: Fronts


def set_up(grid: SolidGrid) -> SolidGeometry:
    """Mesh a grid and analyse it.

    Raises
    ------
    FoldedElement
        An element is folded over.
    """
    mesh = build_mesh(grid)
    return SolidGeometry(mesh, integrate(mesh), lay_fronts(mesh))


class SolidRun:
    """One case on one geometry.

    Parameters
    ----------
    share : float
        The part of the probe that the mesh stands for: half of it on either side of a plane of symmetry.
    positions : iterable of float
        Where the probe is going to stop, which tells what of the factor will be needed again.
    """

    def __init__(
        self,
        case: Case,
        settings: Settings,
        geometry: SolidGeometry,
        share: float,
        positions: Iterable[float],
    ) -> None:
        self.case, self.mesh, self.share = case, geometry.mesh, share
        body = Body(geometry.mesh, geometry.integrals, elasticity(case, geometry.mesh, geometry.integrals))
        shape = FaceShape(
            ProbeShape(case.probe_radius_mm, case.face_half_mm, case.fillet_per_mm2),
            ProbeShape(case.across_radius_mm, case.across_half_mm, case.across_fillet_per_mm2),
        )
        self.contact = FaceContact(geometry.mesh, shape)
        solver = Multifrontal(geometry.fronts, [near_probe(geometry.mesh, x) for x in factored(positions)])
        self.newton = SolidNewton(body, self.contact, solver, settings.tolerance)
        self.predictor = SolidPredictor(geometry.mesh, geometry.integrals.volume)

    def force(self, F_rel: float) -> float:
        """What the mesh's part of the probe bears, mN."""
        return 1000.0 * replace(self.case, F_rel=F_rel).F_N * self.share

    def press(self, position: float, force: float, start: State) -> State:
        """The state at the first position, reached from a guess or, failing that, by raising the force."""
        try:
            return self._upright(self.newton.solve(start, position, force, 15))
        except NoConvergence:
            return self.load(None, position, force)

    def load(self, state: State | None, position: float, force: float, rough: bool = False) -> State:
        """Raise the force from `state`'s, or from nothing: at once or, failing that, in growing steps."""
        if state is None:
            state = self._unloaded(0.1)
        done = float(self.contact.weight @ np.maximum(state.multiplier, 0.0))
        step = force - done
        while done < force * (1 - 1e-9):
            target = min(done + step, force)
            try:
                enough = rough or target < force
                state, done = self.newton.solve(state, position, target, careful=True, rough=enough), target
                step *= 2.5
            except NoConvergence as error:
                step /= 3
                if step < _LEAST_SHARE * force:
                    raise StrokeError(self.case.code, position, f"pressing, {error}") from None
        return state

    def _unloaded(self, depth: float) -> State:
        """Undeformed tissue, the probe `depth` below its surface."""
        mesh = self.mesh
        rest = np.zeros(3 * len(mesh.nodes_mm))
        pressure = np.zeros((len(mesh.elements), 4))
        return State(rest, self.case.centre_mm - depth, np.zeros(mesh.surface.size), pressure)

    def slide(self, tracks: Sequence[Track], new: float) -> None:
        """Add the states at `new` to all tracks: the middle force's with a factor of its own, the others with
        the same."""
        leader = tracks[len(tracks) // 2]
        guess = self.predictor(leader.recent, new)
        self._slide(leader, new, guess)
        found = leader.recent[-1][1]
        for track in tracks:
            if track is leader:
                continue
            start = self.predictor(track.recent, new)
            start.u += found.u - guess.u
            start.pressure += found.pressure - guess.pressure
            start.height += found.height - guess.height
            try:
                state = self._upright(self.newton.solve(start, new, track.force))
                track.add(new, state)
            except NoConvergence:
                self._slide(track, new, start)

    def _slide(self, track: Track, new: float, start: State) -> None:
        """Add the state at `new` to a track; what does not converge is done in halves."""
        reason = NoConvergence()
        for careful in (False, True):
            try:
                state = self.newton.solve(start, new, track.force, careful=careful, onwards=not careful)
                track.add(new, self._upright(state))
                return
            except NoConvergence as error:
                reason = error
                start = self.predictor(track.recent[-1:], new)
        old = track.recent[-1][0]
        if new - old < 4.0 / 2**_HALVINGS:
            raise StrokeError(self.case.code, new, f"sliding, {reason}")
        for place in ((old + new) / 2, new):
            self._slide(track, place, self.predictor(track.recent, place))

    @staticmethod
    def _upright(state: State) -> State:
        if state.smallest_jacobian <= 0.0:
            raise NoConvergence(inside_out(state))
        return state

    def read(self, state: State, position: float, force: float) -> dict[str, Any]:
        """What the probe feels, checked: a wrong equilibrium must not pass for a result."""
        skin = self.contact.pressure(state.u, state.multiplier)
        half = self.mesh.grid.half
        x, z = skin.x - position, skin.z
        touching = x[skin.pressure > 0]
        peak = np.unravel_index(int(skin.pressure.argmax()), x.shape)
        row = {
            "displacement_mm": self.case.centre_mm - state.height,
            "images_kPa": skin.read(position, SENSORS_MM, places_mm(ACROSS), half),
            "peak_mm": x[peak],
            "peak_across_mm": z[peak],
            "peak_kPa": skin.pressure[peak],
            "contact_mm": np.array([touching.min(initial=0.0), touching.max(initial=0.0)]),
            "force_error": skin.force / force - 1.0,
            "smallest_jacobian": state.smallest_jacobian,
        }
        deepest_mm = self.case.centre_mm + self.case.half_down
        if trouble := fault(row, state, deepest_mm, "tissue"):
            raise StrokeError(self.case.code, position, trouble)
        return row


class Track:
    """The states of one force along the stroke: the last three, with their positions."""

    def __init__(self, force: float, position: float, state: State) -> None:
        self.force = force
        self.recent = [(position, state)]

    def add(self, position: float, state: State) -> None:
        """The next state; the fourth last is forgotten."""
        self.recent = [*self.recent[-2:], (position, state)]
