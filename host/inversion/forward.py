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
from palpate.sim.tissue.frames import Frames, solve_frames
from palpate.sim.tissue.state import State
from palpate.sim.tissue.topology import OutsideTopology, Topology

Floats = NDArray[np.float64]

COARSE = Settings()
FINE = Settings(hx_mm=1.0)
_REACH_MM = 56.0
_PRESS_REACH_MM = 24.0
"""Frames at one place need no more."""
_FAR = 0.5
"""Guesses by derivatives are for steps within so many of the priors' standard deviations."""


@dataclass
class Computed:
    """Frames of one guess: its unknowns, places and forces, and what they give."""

    theta: Floats
    places_mm: Floats
    forces_N_per_m: Floats
    frames: Frames
    topology: Topology
    derivatives: Derivatives | None = None
    chain: Floats | None = None

    @property
    def images(self) -> Floats:
        """(n, rows), kPa."""
        return self.frames.images_kPa

    @property
    def depth(self) -> Floats:
        """(n,), mm."""
        return self.frames.displacement_mm


class Forward:
    """Computes frames of one class on one mesh, whose topology stays as long as the guesses are near."""

    def __init__(self, of: Class, settings: Settings, sensors: Floats = OWN_PLACES) -> None:
        self.of, self.settings, self.sensors = of, settings, sensors
        self.solved = 0
        self._topology: Topology | None = None
        self._last: Computed | None = None

    def __call__(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> Computed:
        """Frames (n,) of a guess.

        Raises
        ------
        CaseError, StrokeError
            There is no such tissue, or no equilibrium in it.
        """
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
        self.solved += 1
        return Computed(theta.copy(), places_mm, forces_N_per_m, frames, topology)

    def differentiated(self, at: Computed) -> tuple[Floats, Floats]:
        """Derivatives of images (n, rows, k + 2) and depth (n, k + 2) by unknowns, place and ln force."""
        at.derivatives = found = differentiate(at.frames, at.topology, self.of.fields)
        fields, k = len(self.of.fields), len(at.theta)
        chain = np.zeros((fields + 2, k + 2))
        chain[:fields, :k] = self.of.chain(at.theta)
        chain[fields, k] = 1.0
        at.chain = chain[:fields, :k]
        images, depth = found.images @ chain, found.displacement @ chain
        images[:, :, k + 1] = found.images[:, :, -1] * at.forces_N_per_m[:, None]
        depth[:, k + 1] = found.displacement[:, -1] * at.forces_N_per_m
        self._last = at
        return images, depth

    def _guesses(
        self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats, topology: Topology
    ) -> list[State] | None:
        last = self._last
        if last is None or last.topology is not topology or last.derivatives is None or last.chain is None:
            return None
        change = theta - last.theta
        if np.abs(change / self.of.column("sd")).max() > _FAR:
            return None
        n = len(places_mm)
        steps = np.empty((n, len(self.of.fields) + 2))
        steps[:, :-2] = last.chain @ change
        steps[:, -2] = places_mm - last.places_mm
        steps[:, -1] = forces_N_per_m - last.forces_N_per_m
        return last.derivatives.carried(last.frames, steps)
