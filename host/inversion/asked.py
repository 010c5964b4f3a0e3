"""What the solver is asked about strokes: few frames, of one guess after the other.

Along one side of the lump the probe is pressed and slides from frame to frame. The other side's frames, whose
forces are others, are carried on from those nearest to them. (From the last guess's frames Newton's method
takes half as many steps again.) In fat of 10 kPa. Units: mm, kPa, N/m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.classes import FAT_KPA, Class
from palpate.sim.tissue import Settings
from palpate.sim.tissue.derivatives import Derivatives, differentiate
from palpate.sim.tissue.frames import SolvedFrames, solve_frames
from palpate.sim.tissue.geometry import Geometry
from palpate.sim.tissue.state import State
from palpate.sim.tissue.topology import Topology, follow

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PRESS = -1
"""The way of a press's frames."""
_PAST_MM, _APART_MM = 4.0, 0.3
"""States so near lead on to a frame, if they are so far apart."""
_CARRIED = 1.0, 0.1
"""So far apart, in mm and by ln F, states are as unlike in either way."""


class Alike(NamedTuple):
    """How near frames are that stand for each other: in mm, by ln F, and by ln F in a press."""

    mm: float
    ln_F: float
    pressed: float


@dataclass(frozen=True)
class Frames:
    """Frames (n,) of a guess.

    Attributes
    ----------
    places_mm, ln_F : ndarray (n,)
        Before the lump or mirrored there; forces over the fat's modulus.
    way : ndarray (n,), int
        One for each side of each stroke; `PRESS`.
    """

    places_mm: Floats
    ln_F: Floats
    way: Ints

    def unlike(self, alike: Alike, taken: Frames | None = None) -> Frames:
        """Those unlike all that are taken before them; of a press the greatest forces first."""
        return self._of(self.chosen(alike, taken))

    def chosen(self, alike: Alike, taken: Frames | None = None) -> Ints:
        """Which frames `unlike` has."""
        places, ln_F = ([], []) if taken is None else (taken.places_mm.tolist(), taken.ln_F.tolist())
        pressed, chosen = self.way == PRESS, []
        for k in np.lexsort((np.where(pressed, -1, 1) * self.ln_F, self.places_mm, pressed)).tolist():
            x, F = self.places_mm[k], self.ln_F[k]
            within = alike.mm, alike.pressed if pressed[k] else alike.ln_F
            if (far_off(x, F, np.array(places), np.array(ln_F), *within) > 1.0).all():
                chosen.append(k)
                places.append(x)
                ln_F.append(F)
        return np.array(chosen, int)

    def longest(self) -> Frames:
        """The presses, and the way that reaches farthest."""
        pressed = self.way == PRESS
        far = np.where(pressed, -1.0, np.abs(self.places_mm)).argmax()
        return self._of(np.flatnonzero(pressed | (self.way == self.way[far])))

    def _of(self, which: Ints) -> Frames:
        return Frames(self.places_mm[which], self.ln_F[which], self.way[which])


class Solves:
    """Computes some frames of one guess after the other, under one class."""

    def __init__(self, of: Class, settings: Settings) -> None:
        self._of, self._settings = of, settings
        self._topology: Topology | None = None

    def __call__(self, theta: Floats, frames: Frames, alike: Alike) -> SolvedFrames:
        """Frames (m,) of a guess that stand for all of them; first those along one side.

        Raises
        ------
        CaseError, StrokeError
            There is no such tissue, or no equilibrium in it.
        """
        geometry = self._mesh(theta, frames.places_mm)

        def solve(some: Frames, near: SolvedFrames | None) -> SolvedFrames:
            places, F = some.places_mm, FAT_KPA * np.exp(some.ln_F)
            guesses = None if near is None else _carried(near, places, F)
            return solve_frames(self._of.case(theta), self._settings, geometry, places, F, guesses)

        some = frames.longest().unlike(alike)
        found, others = solve(some, None), frames.unlike(alike, some)
        return _together(found, solve(others, found)) if len(others.ln_F) else found

    def steep(self, found: SolvedFrames, alike: Alike) -> tuple[SolvedFrames, Derivatives]:
        """Some frames of the last guess that stand for all of them, and their derivatives.

        Raises
        ------
        StrokeError
            An equilibrium is not stable.
        """
        assert self._topology is not None
        ln_F = np.log(found.forces_N_per_m / FAT_KPA)
        every = Frames(found.places_mm, ln_F, np.zeros(len(ln_F), int))
        some = _some(found, every.chosen(alike))
        return some, differentiate(some, self._topology, self._of.fields)

    def _mesh(self, theta: Floats, places_mm: Floats) -> Geometry:
        """On a mesh of the last guess's topology, where that will do."""
        reach = float(places_mm.min()) - 1.0, float(places_mm.max()) + 1.0
        self._topology, geometry = follow(self._topology, self._of.case(theta), self._settings, *reach)
        return geometry


def _carried(known: SolvedFrames, places_mm: Floats, forces_N_per_m: Floats) -> list[State]:
    """Where frames begin: at the nearest state; two of them lead on to a place."""
    at, out = known.places_mm, []
    for x, away in zip(places_mm, _away(places_mm, forces_N_per_m, known)):
        first = int(away.argmin())
        others = np.flatnonzero((np.abs(at - at[first]) > _APART_MM) & (np.abs(at - x) < _PAST_MM))
        leading = (*others[away[others].argsort()[:1]].tolist(), first)
        out.append(known.run.predictor([(float(at[k]), known.states[k]) for k in leading], float(x)))
    return out


def _away(places_mm: Floats, forces_N_per_m: Floats, known: SolvedFrames) -> Floats:
    """How far (n, m) frames are from those known."""
    ln_F = np.log(forces_N_per_m)[:, None], np.log(known.forces_N_per_m)
    return far_off(places_mm[:, None], ln_F[0], known.places_mm, ln_F[1], *_CARRIED)


def _some(solved: SolvedFrames, which: Ints) -> SolvedFrames:
    """Some of the frames."""
    places, forces = solved.places_mm[which], solved.forces_N_per_m[which]
    return replace(
        solved, places_mm=places, forces_N_per_m=forces, order=np.lexsort((forces, places)),
        states=[solved.states[k] for k in which.tolist()], images_kPa=solved.images_kPa[which],
        displacement_mm=solved.displacement_mm[which],
    )  # fmt: skip


def _together(first: SolvedFrames, other: SolvedFrames) -> SolvedFrames:
    """The frames of both."""
    places, forces, images, depth = (
        np.concatenate([getattr(one, name) for one in (first, other)])
        for name in ("places_mm", "forces_N_per_m", "images_kPa", "displacement_mm")
    )
    return SolvedFrames(
        first.run, places, forces, np.lexsort((forces, places)), first.states + other.states,
        images, depth, first.sensors,
    )  # fmt: skip


def far_off(
    places_mm: Floats, ln_F: Floats, others_mm: Floats, others_ln_F: Floats, mm: float, by_ln_F: float
) -> Floats:
    """How unlike frames are; up to 1 one may stand for the other."""
    out: Floats = np.hypot((places_mm - others_mm) / mm, (ln_F - others_ln_F) / by_ln_F)
    return out
