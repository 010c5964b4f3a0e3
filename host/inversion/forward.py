"""The forward model of a class: images and displacements of frames, and their derivatives by the unknowns.

In fat of 10 kPa. Units: mm, kPa, N/m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.classes import Class
from palpate.inversion.track import Track, side_by_side, track
from palpate.sim.tissue import Settings
from palpate.sim.tissue.derivatives import Derivatives, differentiate
from palpate.sim.tissue.frames import SolvedFrames, solve_frames
from palpate.sim.tissue.reading import OWN_PLACES
from palpate.sim.tissue.state import State
from palpate.sim.tissue.topology import Topology, follow

Floats = NDArray[np.float64]

_TOLERANCE = 1e-3
"""The misfit knows no difference from 1e-5 (less than .03); an iteration in four is saved."""
COARSE = Settings(shells=3, tolerance=_TOLERANCE, to_border=True)
FINE = Settings(hx_mm=1.0, shells=3, tolerance=_TOLERANCE, to_border=True)
_REACH_MM = 56.0
_PRESS_REACH_MM = 24.0
"""Frames at one place need no more."""
_FAR = 2.0
"""Guesses by derivatives are for steps within so many of the priors' standard deviations."""
_ELSEWHERE_MM = 2.5
"""Nor where a place has moved by more."""


@dataclass
class Predicted:
    """Frames of one guess: its unknowns, places and forces, and what they give.

    Attributes
    ----------
    images : ndarray (n, rows)
        kPa.
    depth : ndarray (n,)
        mm.
    """

    theta: Floats
    places_mm: Floats
    forces_N_per_m: Floats
    images: Floats
    depth: Floats

    def on_mesh_of(self, other: Predicted) -> bool:
        """Whether another guess was computed on a mesh whose derivatives may be carried on to this one."""
        return False

    @property
    def own(self) -> Floats:
        """What each frame's pressures depend on, (n, k + 2): tissue and lump, place, ln force."""
        n = len(self.places_mm)
        return np.column_stack([np.tile(self.theta, (n, 1)), self.places_mm, np.log(self.forces_N_per_m)])


@dataclass
class Computed(Predicted):
    """Frames that the solver has computed.

    Attributes
    ----------
    solved : SolvedFrames
        What it has said, on a mesh of the topology.
    track : Track or None
        How that leads to the frames; None: they are the frames.
    """

    solved: SolvedFrames
    topology: Topology
    track: Track | None

    def on_mesh_of(self, other: Predicted) -> bool:
        """Whether both are on meshes of one topology."""
        return isinstance(other, Computed) and self.topology is other.topology

    def of(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> bool:
        """Whether these are the guess's own."""
        pairs = (self.theta, theta), (self.places_mm, places_mm), (self.forces_N_per_m, forces_N_per_m)
        return all(np.array_equal(mine, other) for mine, other in pairs)


@dataclass(frozen=True)
class Slopes:
    """Derivatives of images (n, 16, k + 2) and depth (n, k + 2) by tissue and lump, place, ln force."""

    images: Floats
    depth: Floats

    def secant(self, before: Predicted, now: Predicted, scale: Floats) -> Slopes:
        """The nearest slopes that lead from one guess to the next: Broyden's update, frame by frame."""
        step = now.own - before.own
        weighted = step / scale**2
        length = np.maximum((weighted * step).sum(1), 1e-12)
        wrong = now.images - before.images - np.einsum("nik,nk->ni", self.images, step)
        deeper = now.depth - before.depth - (self.depth * step).sum(1)
        weighted = weighted / length[:, None]
        return Slopes(
            self.images + wrong[:, :, None] * weighted[:, None], self.depth + deeper[:, None] * weighted
        )


@dataclass
class Emulated(Predicted):
    """Frames that an emulator has said, with their derivatives by tissue and lump, place, ln force."""

    slopes: Slopes


class SaysSlopes:
    """A forward model whose frames carry their derivatives."""

    def slopes(self, at: Emulated) -> Slopes:
        """Derivatives at a guess."""
        return at.slopes


class Predicts(Protocol):
    """A forward model: `Forward`, and the emulators set right."""

    scale: Floats

    def __call__(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> Predicted:
        """Frames (n,) of a guess; CaseError or StrokeError where there are none."""
        ...

    def slopes(self, at: Any) -> Slopes:
        """Derivatives at a guess of its own."""
        ...


@runtime_checkable
class Rubs(Protocol):
    """A forward model that knows what a face that rubs would change."""

    def by_friction(self, at: Any) -> Floats:
        """Derivatives of images and displacement, (n, 17), by the friction of the face, from none at all."""
        ...


@runtime_checkable
class Emulates(Predicts, Protocol):
    """An emulator that the solver sets right.

    Attributes
    ----------
    unsure : float
        How far off frames still are, over the mean pressure.
    """

    @property
    def unsure(self) -> float: ...

    def away(self, theta: Floats) -> float:
        """How far a guess is from the nearest one computed, by the unknowns' spreads beforehand."""
        ...

    def set_right(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> None:
        """Let the solver compute a guess; CaseError or StrokeError where it cannot."""
        ...


class Forward:
    """Computes frames of one class on one mesh, whose topology stays as long as the guesses are near.

    Parameters
    ----------
    strokes : sequence of (int, int)
        How many frames each stroke has, and how many of them are its press; none: every frame is solved.
    """

    def __init__(
        self,
        of: Class,
        settings: Settings,
        sensors: Floats = OWN_PLACES,
        strokes: Sequence[tuple[int, int]] = (),
    ) -> None:
        self.of, self.settings, self.sensors, self.strokes = of, settings, sensors, tuple(strokes)
        self.scale = of.scale
        self._topology: Topology | None = None
        self._tracks: Sequence[Track | None] = ()
        self._derivatives: tuple[SolvedFrames, Topology, Derivatives] | None = None
        self._last: Computed | None = None

    def __call__(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> Computed:
        """Frames (n,) of a guess.

        Raises
        ------
        CaseError, StrokeError
            There is no such tissue, or no equilibrium in it.
        """
        last = self._last
        if last is not None and last.of(theta, places_mm, forces_N_per_m):
            return last
        case = self.of.case(theta)
        reach = _REACH_MM if np.ptp(places_mm) else _PRESS_REACH_MM
        topology, geometry = follow(self._topology, case, self.settings, -reach, reach)
        on = self._track(places_mm, forces_N_per_m)
        there = (places_mm, forces_N_per_m) if on is None else (on.places_mm, on.forces_N_per_m)
        guesses = self._guesses(theta, *there, topology)
        solved = solve_frames(case, self.settings, geometry, *there, guesses, self.sensors)
        images, depth = solved.images_kPa, solved.displacement_mm
        if on is not None:
            by_image, by_depth = self._by_force(solved, topology)
            images, depth = on.frames(images, by_image), on.frames(depth, by_depth)
        self._topology = topology
        self._last = Computed(theta.copy(), places_mm, forces_N_per_m, images, depth, solved, topology, on)
        return self._last

    def _track(self, places_mm: Floats, forces_N_per_m: Floats) -> Track | None:
        if not self.strokes:
            return None
        ends = np.cumsum([frames for frames, _ in self.strokes])[:-1]
        pairs = zip(np.split(places_mm, ends), np.split(forces_N_per_m, ends))
        before, column_mm = self._tracks or [None] * len(self.strokes), self.settings.hx_mm
        tracks = [
            track(*pair, press, column_mm, last)
            for pair, (_, press), last in zip(pairs, self.strokes, before)
        ]
        self._tracks = tracks
        return side_by_side(tracks)

    def _by_force(self, solved: SolvedFrames, topology: Topology) -> tuple[Floats, Floats]:
        """Derivatives of images and depth by ln F; the last ones there are will do."""
        known = self._derivatives
        if known is None or known[1] is not topology or len(known[0].states) != len(solved.states):
            known = self._differentiated(solved, topology)
        force, found = solved.forces_N_per_m, known[2]
        return found.images[:, :, -1] * force[:, None], found.displacement[:, -1] * force

    def _differentiated(
        self, solved: SolvedFrames, topology: Topology
    ) -> tuple[SolvedFrames, Topology, Derivatives]:
        if self._derivatives is None or self._derivatives[0] is not solved:
            self._derivatives = solved, topology, differentiate(solved, topology, self.of.fields)
        return self._derivatives

    def like(self, other: Forward) -> None:
        """Begin on a mesh of the topology that another has come to; its solver is the other's own."""
        if self._topology is None and (topology := other._topology) is not None:
            self._topology = Topology(topology.case, topology.settings, *topology.span_mm)

    def slopes(self, at: Computed) -> Slopes:
        """Derivatives at a guess."""
        found = self._differentiated(at.solved, at.topology)[2]
        chain = self.of.chain(at.theta)
        solved, force = at.solved, at.solved.forces_N_per_m
        each = []
        for values, by in ((solved.images_kPa, found.images), (solved.displacement_mm, found.displacement)):
            by_force = by[..., -1] * (force[:, None] if by.ndim == 3 else force)
            by_theta, by_place = by[..., :-2] @ chain, by[..., -2]
            if (on := at.track) is not None:
                by_theta, by_place = on.of_shares(by_theta), on.by_place(values, by_force)
                by_force = on.of_shares(by_force)
            each.append(np.concatenate([by_theta, by_place[..., None], by_force[..., None]], -1))
        return Slopes(*each)

    def by_friction(self, at: Computed) -> Floats:
        """Derivatives of images and displacement, (n, 17), by the friction of the face, from none at all."""
        found = differentiate(at.solved, at.topology, ("friction",))
        there = np.column_stack([found.images[:, :, 0], found.displacement[:, 0]])
        return there if at.track is None else at.track.of_shares(there)

    def _guesses(
        self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats, topology: Topology
    ) -> list[State] | None:
        """The last guess's states carried on by the newest derivatives there are."""
        last, known = self._last, self._derivatives
        if last is None or known is None:
            return None
        if last.topology is not topology or known[1] is not topology:
            return None
        before = last.solved
        if len(before.states) != len(places_mm) or len(known[0].states) != len(places_mm):
            return None
        if np.abs(places_mm - before.places_mm).max() > _ELSEWHERE_MM:
            return None
        if np.abs((theta - last.theta) / self.of.column("sd")).max() > _FAR:
            return None
        steps = np.empty((len(places_mm), len(self.of.fields) + 2))
        steps[:, :-2] = self.of.values(theta) - self.of.values(last.theta)
        steps[:, -2] = places_mm - before.places_mm
        steps[:, -1] = forces_N_per_m - before.forces_N_per_m
        return known[2].carried(before, steps)
