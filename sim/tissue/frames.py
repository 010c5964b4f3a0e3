"""Equilibria at many places, each under a force of its own: what the frames of one recording have felt.

Units: mm, kPa, N/m.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.case import FORCE_UNIT_N_PER_M, Case
from palpate.sim.tissue.checks import inside_out
from palpate.sim.tissue.errors import StrokeError
from palpate.sim.tissue.geometry import Geometry
from palpate.sim.tissue.newton import NoConvergence
from palpate.sim.tissue.one_thread import one_blas_thread
from palpate.sim.tissue.reading import OWN_PLACES
from palpate.sim.tissue.run import StrokeRun
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.state import State, combine, extrapolation

Floats = NDArray[np.float64]

_SAME_PLACE_MM = 0.05
"""Nearer frames differ in their force rather than in their place, as far as guessing goes."""
_LONGEST_STEP_MM = 5.0
_PRESS_ANEW_MM = 9.0
"""Over a longer way pressing again costs less than sliding there."""
_HALVINGS = 5
_GUESSED_STEPS = 5
_GUESSES_FAIL = 2
"""Where so many guesses in a row have led nowhere, the others will not: they were all carried equally far.
But for those of a press: small forces need nearer ones."""


@dataclass
class SolvedFrames:
    """n frames of one case.

    Attributes
    ----------
    run : StrokeRun
        Case, mesh and solver that they were computed with.
    places_mm, forces_N_per_m : ndarray (n,)
    order : ndarray (n,), int
        The way from frame to frame on which neighbours are near.
    states : list of State
        The equilibria.
    images_kPa : ndarray (n, rows)
    displacement_mm : ndarray (n,)
    sensors : ndarray (rows, 9)
        Where they are read.
    """

    run: StrokeRun
    places_mm: Floats
    forces_N_per_m: Floats
    order: NDArray[np.int64]
    states: list[State]
    images_kPa: Floats
    displacement_mm: Floats
    sensors: Floats = field(default_factory=lambda: OWN_PLACES)


def solve_frames(
    case: Case,
    settings: Settings,
    geometry: Geometry,
    places_mm: Floats,
    forces_N_per_m: Floats,
    guesses: Sequence[State] | None = None,
    sensors: Floats = OWN_PLACES,
) -> SolvedFrames:
    """Equilibria of n frames in the plane.

    Parameters
    ----------
    geometry : Geometry
        Of `case`; from `geometry_of` or from a topology.
    places_mm, forces_N_per_m : ndarray (n,)
        In any order; `case.F_rel` is not used.
    guesses : sequence of State, optional
        A guess for each frame.
    sensors : ndarray (rows, 9)
        `palpate.sim.tissue.reading.places_read` of an array.

    Raises
    ------
    StrokeError
        There is no equilibrium at one of them.
    """
    places, forces = np.asarray(places_mm, float), np.asarray(forces_N_per_m, float)
    order = np.lexsort((forces, places))
    run = StrokeRun(case, settings, geometry)
    march = _March(run)
    states: list[State | None] = [None] * len(places)
    with one_blas_thread():
        for k in order.tolist():
            states[k] = march.on(float(places[k]), float(forces[k]), None if guesses is None else guesses[k])
    found = [state for state in states if state is not None]
    images, depth = np.empty((len(found), len(sensors))), np.empty(len(found))
    for k, state in enumerate(found):
        x, pressure, _ = run.contact.pressure(state.u, state.multiplier, places[k])
        images[k] = run.reading(x - places[k], pressure, sensors)
        depth[k] = run.surface_mm - state.height
    return SolvedFrames(run, places, forces, order, found, images, depth, sensors)


class _March:
    """Goes from frame to frame and remembers the last few."""

    def __init__(self, run: StrokeRun) -> None:
        self._run = run
        self._failed: list[float] = []
        self._past: list[tuple[float, float, State]] = []

    def on(self, place: float, force: float, guess: State | None = None) -> State:
        """The equilibrium of the next frame."""
        state = self._from(guess, place, force)
        if state is None and (not self._past or place - self._past[-1][0] > _PRESS_ANEW_MM):
            state = self._pressed(place, force)
        elif state is None:
            last, last_force, _ = self._past[-1]
            steps = max(1, math.ceil((place - last) / _LONGEST_STEP_MM))
            for part in (k / steps for k in range(1, steps)):
                x, F = last + part * (place - last), last_force + part * (force - last_force)
                self._past = [*self._past, (x, F, self._reached(x, F, 0))][-3:]
            state = self._reached(place, force, 0)
        self._past = [*self._past, (place, force, state)][-3:]
        return state

    def _pressed(self, place: float, force: float) -> State:
        self._run.case = replace(self._run.case, F_rel=force / FORCE_UNIT_N_PER_M)
        return self._checked(self._run.press(place, None))

    def _from(self, guess: State | None, place: float, force: float) -> State | None:
        if guess is None or self._hopeless(place):
            return None
        try:
            state = self._checked(self._run.newton.solve(guess, place, force, _GUESSED_STEPS))
        except NoConvergence:
            self._failed.append(place)
            return None
        self._failed = []
        return state

    def _hopeless(self, place: float) -> bool:
        """Whether a guess would lead nowhere: the last ones have not, at two places, or at this one."""
        last = self._failed[-_GUESSES_FAIL:]
        if len(last) < _GUESSES_FAIL:
            return False
        return abs(last[0] - last[-1]) > _SAME_PLACE_MM or abs(last[-1] - place) <= _SAME_PLACE_MM

    def _reached(self, place: float, force: float, halved: int) -> State:
        """From the last frames; what does not converge is done in halves."""
        reason = NoConvergence()
        for past, careful in ((self._past, False), (self._past[-1:], True)):
            try:
                guess = self._carried(past, place, force)
                return self._checked(self._run.newton.solve(guess, place, force, careful=careful))
            except NoConvergence as error:
                reason = error
        if halved == _HALVINGS:
            raise StrokeError(self._run.case.code, place, f"under {force:.4g} N/m, {reason}")
        last_place, last_force, _ = self._past[-1]
        here, half = (last_place + place) / 2, (last_force + force) / 2
        middle = self._reached(here, half, halved + 1)
        self._past = [*self._past, (here, half, middle)][-3:]
        return self._reached(place, force, halved + 1)

    def _carried(self, past: Sequence[tuple[float, float, State]], place: float, force: float) -> State:
        """The last states carried on: along the force where the place stays, else from place to place."""
        last_place, last_force, _ = past[-1]
        if abs(place - last_place) < _SAME_PLACE_MM:
            some = _distinct(past, lambda frame: frame[1], 1e-3 * last_force)
            some = [frame for frame in some if abs(frame[0] - last_place) < _SAME_PLACE_MM]
            return _carried_in_force([(f, state) for _, f, state in some], force)
        some = _distinct(past, lambda frame: frame[0], _SAME_PLACE_MM)
        return self._run.predictor([(x, state) for x, _, state in some], place)

    def _checked(self, state: State) -> State:
        if not state.smallest_jacobian > 0.0:
            raise NoConvergence(inside_out(state))
        return state


_Frame = tuple[float, float, State]


def _distinct(past: Sequence[_Frame], of: Callable[[_Frame], float], least: float) -> list[_Frame]:
    """Those of the past that differ by so much from each later one, the last among them."""
    out: list[_Frame] = []
    for frame in reversed(past):
        if all(abs(of(frame) - of(other)) > least for other in out):
            out.insert(0, frame)
    return out


def _carried_in_force(past: Sequence[tuple[float, State]], force: float) -> State:
    weights = extrapolation([f for f, _ in past], force)
    states = [state for _, state in past]
    multiplier = combine(weights, [state.multiplier for state in states])
    return State(
        combine(weights, [state.u for state in states]),
        float(np.dot(weights, [state.height for state in states])),
        np.where(states[-1].multiplier > 0, np.maximum(multiplier, 0.0), 0.0),
        combine(weights, [state.pressure for state in states]),
    )
