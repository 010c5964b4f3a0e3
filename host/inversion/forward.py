"""The forward model of a class: images and displacements of frames, and their derivatives by the unknowns.

In fat of 10 kPa. Units: mm, kPa, N/m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.classes import Class
from palpate.sim.tissue import Settings
from palpate.sim.tissue.contact import OWN_PLACES
from palpate.sim.tissue.derivatives import Derivatives, differentiate
from palpate.sim.tissue.frames import SolvedFrames, solve_frames
from palpate.sim.tissue.state import State
from palpate.sim.tissue.topology import OutsideTopology, Topology

Floats = NDArray[np.float64]

COARSE = Settings()
FINE = Settings(hx_mm=1.0)
_REACH_MM = 56.0
_PRESS_REACH_MM = 24.0
"""Frames at one place need no more."""
_FAR = 2.0
"""Guesses by derivatives are for steps within so many of the priors' standard deviations."""


@dataclass
class Computed:
    """Frames of one guess: its unknowns, places and forces, and what they give."""

    theta: Floats
    places_mm: Floats
    forces_N_per_m: Floats
    frames: SolvedFrames
    topology: Topology

    @property
    def images(self) -> Floats:
        """(n, rows), kPa."""
        return self.frames.images_kPa

    @property
    def depth(self) -> Floats:
        """(n,), mm."""
        return self.frames.displacement_mm

    def on_mesh_of(self, other: Computed) -> bool:
        """Whether another guess was computed on a mesh of the same topology."""
        return self.topology is other.topology

    def of(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> bool:
        """Whether these are the guess's own."""
        pairs = (self.theta, theta), (self.places_mm, places_mm), (self.forces_N_per_m, forces_N_per_m)
        return all(np.array_equal(mine, other) for mine, other in pairs)

    @property
    def own(self) -> Floats:
        """What each frame's pressures depend on, (n, k + 2): tissue and lump, place, ln force."""
        n = len(self.places_mm)
        return np.column_stack([np.tile(self.theta, (n, 1)), self.places_mm, np.log(self.forces_N_per_m)])


@dataclass(frozen=True)
class Slopes:
    """Derivatives of images (n, 16, k + 2) and depth (n, k + 2) by tissue and lump, place, ln force."""

    images: Floats
    depth: Floats

    def secant(self, before: Computed, now: Computed, scale: Floats) -> Slopes:
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


class Forward:
    """Computes frames of one class on one mesh, whose topology stays as long as the guesses are near."""

    def __init__(self, of: Class, settings: Settings, sensors: Floats = OWN_PLACES) -> None:
        self.of, self.settings, self.sensors = of, settings, sensors
        self.scale = np.concatenate([of.column("sd"), [1.0, 0.1]])
        self._topology: Topology | None = None
        self._derivatives: tuple[Topology, Derivatives] | None = None
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
        try:
            if self._topology is None:
                raise OutsideTopology
            topology = self._topology
            geometry = topology.geometry(case)
        except OutsideTopology:
            reach = _REACH_MM if np.ptp(places_mm) else _PRESS_REACH_MM
            topology = Topology(case, self.settings, -reach, reach)
            geometry = topology.geometry(case)
        guesses = self._guesses(theta, places_mm, forces_N_per_m, topology)
        frames = solve_frames(case, self.settings, geometry, places_mm, forces_N_per_m, guesses, self.sensors)
        self._topology = topology
        self._last = Computed(theta.copy(), places_mm, forces_N_per_m, frames, topology)
        return self._last

    def like(self, other: Forward) -> None:
        """Begin on a mesh of the topology that another has come to; its solver is the other's own."""
        if self._topology is None and (topology := other._topology) is not None:
            self._topology = Topology(topology.case, topology.settings, *topology.span_mm)

    def slopes(self, at: Computed) -> Slopes:
        """Derivatives at a guess."""
        found = differentiate(at.frames, at.topology, self.of.fields)
        self._derivatives = at.topology, found
        fields, k = len(self.of.fields), len(at.theta)
        chain = np.zeros((fields + 2, k + 2))
        chain[:fields, :k] = self.of.chain(at.theta)
        chain[fields, k] = 1.0
        images, depth = found.images @ chain, found.displacement @ chain
        images[:, :, k + 1] = found.images[:, :, -1] * at.forces_N_per_m[:, None]
        depth[:, k + 1] = found.displacement[:, -1] * at.forces_N_per_m
        return Slopes(images, depth)

    def by_friction(self, at: Computed) -> Floats:
        """Derivatives of images and displacement, (n, 17), by the friction of the face, from none at all."""
        found = differentiate(at.frames, at.topology, ("friction",))
        return np.column_stack([found.images[:, :, 0], found.displacement[:, 0]])

    def _guesses(
        self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats, topology: Topology
    ) -> list[State] | None:
        """The last guess's states carried on by the newest derivatives there are."""
        last = self._last
        if last is None or self._derivatives is None:
            return None
        if last.topology is not topology or self._derivatives[0] is not topology:
            return None
        if np.abs((theta - last.theta) / self.of.column("sd")).max() > _FAR:
            return None
        steps = np.empty((len(places_mm), len(self.of.fields) + 2))
        steps[:, :-2] = self.of.values(theta) - self.of.values(last.theta)
        steps[:, -2] = places_mm - last.places_mm
        steps[:, -1] = forces_N_per_m - last.forces_N_per_m
        return self._derivatives[1].carried(last.frames, steps)
