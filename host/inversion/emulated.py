"""The forward model of lumps in the plane: an emulator of frames, set right by the solver.

The solver computes a few places of one guess, of half a stroke: the other half is nearly its mirror image.
What it says otherwise is added to the emulator from then on (`corrections`; space mapping, as in `solids`).
In fat of 10 kPa. Units: mm, kPa, N/m.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from palpate import models
from palpate.inversion.asked import PRESS, Alike, Frames, Solves
from palpate.inversion.classes import FAT_KPA, Class
from palpate.inversion.corrections import END_MM, Corrections, Turned
from palpate.inversion.forward import FINE, Emulated, Forward, SaysSlopes, Slopes
from palpate.learn.plane_emulator import (
    LOW,
    MESH,
    PLACE,
    ROWS,
    PlaneEmulator,
    inputs_of,
    read_plane_emulator,
)
from palpate.sim.tissue import Case, CaseError, StrokeError
from palpate.sim.tissue.frames import SolvedFrames, solve_frames
from palpate.sim.tissue.reading import places_read
from palpate.sim.tissue.topology import Topology
from palpate.wire.cells import PITCH_MM, SHAPE

Floats = NDArray[np.float64]

_PITCH_MM = 1.5
_FACE_MM = ROWS * _PITCH_MM
_STEP = 1e-6
"""Of differences."""
AFAR_MM = LOW[PLACE]
"""So far before the lump there is none, as far as the emulator knows."""
_FAR, _NEAR, _PLAIN = Alike(2.0, 0.25, 0.2), Alike(5.0, 0.35, 0.4), Alike(12.0, 0.08, 0.1)
"""The solver is asked about the frames themselves, but for those so like another: of a guess far from all
before it, of one near them, and without a lump. Far away it gives derivatives, too, as far apart as near."""
_FAR_AWAY = 0.7
"""By the unknowns' spreads beforehand."""
_SIDES_MM, _LEAST_MM = (4.0, 9.0, 14.0, 20.0, 28.0, 40.0), 2.0
"""Near there, so far apart, the lump's sides are compared: tissue ends nearer behind it than before it."""
_LUMP, _SOME_LUMP = [0, 1, 3], (np.log(8.0), np.log(8.0), 0.3)


@lru_cache(maxsize=1)
def bundled() -> PlaneEmulator:
    """The emulator that comes with Palpate."""
    return read_plane_emulator(models.plane_emulator_path())


class EmulatedForward(SaysSlopes):
    """Emulates frames of one class, under the usual face.

    Parameters
    ----------
    strokes : sequence of (int, int)
        How many frames each stroke has, and how many of them are its press.

    Attributes
    ----------
    unsure : float
        How far off the frames of a stroke are where the solver was asked first, over the mean pressure.
    """

    def __init__(self, of: Class, strokes: Sequence[tuple[int, int]]) -> None:
        self.of, self.strokes = of, tuple(strokes)
        self.scale = of.scale
        self._stroke = np.repeat(np.arange(len(strokes)), [frames for frames, _ in strokes])
        self._press = np.concatenate([np.arange(frames) < press for frames, press in strokes])
        self._emulator = bundled()
        self._corrections = Corrections(of.column("sd"), ROWS + 1)
        self._solves = Solves(of, MESH)
        self._behind: CubicSpline | None = None
        self.unsure = 0.0

    def __call__(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> Emulated:
        """Frames (n,) of a guess.

        Raises
        ------
        CaseError
            There is no such tissue.
        """
        base, chain = self._inputs(theta)
        ln_F = np.log(forces_N_per_m / FAT_KPA)
        y, by = self._frames(base, places_mm, ln_F)
        slopes = np.concatenate([by[..., :PLACE] @ chain, by[..., PLACE:]], -1)
        more, by_more = self._corrected(theta, places_mm, ln_F)
        y, slopes = y + more, slopes + by_more
        unit = forces_N_per_m / _FACE_MM
        images, depth = y[:, :ROWS] * unit[:, None], np.exp(y[:, ROWS])
        slopes *= np.column_stack([np.tile(unit[:, None], (1, ROWS)), depth])[..., None]
        slopes[:, :ROWS, -1] += images
        return Emulated(
            theta, places_mm, forces_N_per_m, images, depth, Slopes(slopes[:, :ROWS], slopes[:, ROWS])
        )

    def set_right(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> None:
        """Let the solver compute a guess.

        Raises
        ------
        CaseError, StrokeError
            There is no such tissue, or no equilibrium in it.
        """
        ln_F = np.log(forces_N_per_m / FAT_KPA)
        before, behind = self._before(places_mm)
        way = np.where(self._press, PRESS, 2 * self._stroke + behind)
        frames = Frames(np.clip(before, -END_MM, END_MM), ln_F, way)
        steep = self.of.lump and self.away(theta) > _FAR_AWAY
        alike = _PLAIN if not self.of.lump else _FAR if steep else _NEAR
        solved = self._solves(theta, frames, alike)
        places, asked_F = solved.places_mm, np.log(solved.forces_N_per_m / FAT_KPA)
        if self.of.lump and self._behind is None:
            self._behind = _other_side(self.of.case(theta), solved, float(places_mm.max()))
        wrong = _values(solved) - self._frames(self._inputs(theta)[0], places, asked_F)[0]
        turned = self._turned_by(theta, solved) if steep else None
        smooth = self._corrections.add(theta, places, asked_F, wrong, turned)
        if not self.unsure:
            self.unsure = smooth.off(before[~self._press], ln_F[~self._press])

    def away(self, theta: Floats) -> float:
        """As `Emulates.away`."""
        return self._corrections.away(theta)

    def _turned_by(self, theta: Floats, solved: SolvedFrames) -> Turned:
        """What the solver's derivatives by the unknowns are otherwise."""
        some, found = self._solves.steep(solved, _NEAR)
        places, F = some.places_mm, some.forces_N_per_m
        of_depth = found.displacement / some.displacement_mm[:, None]
        by = np.concatenate([found.images * _FACE_MM / F[:, None, None], of_depth[:, None]], 1)
        base, chain = self._inputs(theta)
        ln_F = np.log(F / FAT_KPA)
        emulated = self._frames(base, places, ln_F)[1][..., :PLACE] @ chain
        return Turned(places, ln_F, by[..., :-2] @ self.of.chain(theta) - emulated)

    def by_friction(self, at: Emulated) -> Floats:
        """Derivatives of images and displacement, (n, 17), by the friction of the face, from none at all.

        Both sides of the lump are computed: a face that rubs leans to one.
        """
        solver = Forward(self.of, FINE, places_read(ROWS, PITCH_MM), self.strokes)
        try:
            return solver.by_friction(solver(at.theta, at.places_mm, at.forces_N_per_m))
        except (CaseError, StrokeError):
            return np.zeros((len(at.depth), ROWS + 1))

    def _before(self, places_mm: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Where frames behind the lump have their mirror images, and which those are; none without a lump."""
        behind = (places_mm > 0) & self.of.lump
        return np.where(behind, -places_mm, places_mm), behind

    def _inputs(self, theta: Floats) -> tuple[Floats, Floats]:
        """The emulator's inputs of tissue and lump, (9,), and their derivatives by the unknowns."""
        here = self._lump_inputs(theta)
        apart = [self._lump_inputs(theta + step) - here for step in _STEP * np.eye(len(theta))]
        return here, np.array(apart).T / _STEP

    def _lump_inputs(self, theta: Floats) -> Floats:
        """Without a lump, those of some lump that is far away."""
        out = inputs_of(self.of.case(theta))
        if not self.of.lump:
            out[_LUMP] = _SOME_LUMP
        return out

    def _frames(self, base: Floats, places_mm: Floats, ln_F: Floats) -> tuple[Floats, Floats]:
        """The emulator's values (n, 17) and slopes (n, 17, 11) on both sides of the lump."""
        before, behind = self._before(places_mm)
        if not self.of.lump:
            before = np.full(len(places_mm), AFAR_MM)
        y, by = self._emulator(np.column_stack([np.tile(base, (len(before), 1)), before, ln_F]))
        y[behind] = _turned(y[behind])
        if self._behind is not None:
            y[behind] += self._behind(np.minimum(places_mm[behind], END_MM))
        by[behind, :ROWS] = by[behind, :ROWS][:, ::-1]
        by[behind, :, PLACE] *= -1
        if not self.of.lump:
            by[..., PLACE] = 0.0
        return y, by

    def _corrected(self, theta: Floats, places_mm: Floats, ln_F: Floats) -> tuple[Floats, Floats]:
        """To be added to frames (n, 17), and derivatives (n, 17, k + 2) by the unknowns, place and ln F."""
        before, behind = self._before(places_mm)
        (out, by_place, by_force), slopes = self._corrections(theta, before, ln_F)
        by = np.concatenate([slopes, by_place[..., None], by_force[..., None]], -1)
        out[behind], by[behind, :ROWS] = _turned(out[behind]), by[behind, :ROWS][:, ::-1]
        by[behind, :, -2] *= -1
        return out, by


def emulates(of: Class) -> bool:
    """Whether the emulator knows the face of a class, and its rows."""
    case = of.case(of.column("mean"))
    if (SHAPE[0], PITCH_MM) != (ROWS, _PITCH_MM):
        return False
    return (
        case.padding_mm_per_kPa == 0 and case.face_half_mm == 10.0 and abs(case.probe_radius_mm - 40.0) < 1.0
    )


def _other_side(case: Case, before: SolvedFrames, reach_mm: float) -> CubicSpline:
    """What is otherwise behind the lump than at a stroke's frames before it, of places (n,): (n, 17)."""
    away, force = -before.places_mm, before.forces_N_per_m
    may = np.flatnonzero(away > _LEAST_MM)
    asked = [x for x in _SIDES_MM if x <= max(reach_mm, _SIDES_MM[0])]
    near = {int(may[np.lexsort((-force[may], np.abs(away[may] - x)))[0]]) for x in asked}
    some = sorted(near, key=lambda k: float(away[k]))
    some = [k for k, last in zip(some, [0.0, *away[some]]) if away[k] > last + _LEAST_MM]
    x = away[some]
    there = Topology(case, MESH, x[0] - 1.0, x[-1] + 1.0)
    behind = solve_frames(case, MESH, there.geometry(case), x, force[some])
    apart = _values(behind) - _turned(_values(before)[some])
    return CubicSpline(np.append(0.0, x), np.vstack([0.0 * apart[:1], apart]), bc_type="natural")


def _values(solved: SolvedFrames) -> Floats:
    """Rows over the mean pressure and ln displacement, (n, 17)."""
    shares = solved.images_kPa * _FACE_MM / solved.forces_N_per_m[:, None]
    return np.column_stack([shares, np.log(solved.displacement_mm)])


def _turned(frames: Floats) -> Floats:
    """Frames (n, 17) on the other side of the lump."""
    return np.concatenate([frames[:, :ROWS][:, ::-1], frames[:, ROWS:]], 1)
