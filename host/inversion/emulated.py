"""The forward model of lumps in the plane: an emulator of frames, set right by the solver.

The solver computes a few places of one guess, of half a stroke: the other half is nearly its mirror image.
What it says otherwise, smoothed along the stroke, is added to the emulator from then on (space mapping, as in
`solids`); by two guesses it turns along the way from one to the other (Broyden). In fat of 10 kPa. Units: mm,
kPa, N/m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from palpate import models
from palpate.inversion.asked import PRESS, Alike, Frames, Solves
from palpate.inversion.classes import FAT_KPA, Class
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
_STEP, _NO_WAY = 1e-6, 1e-9
"""Of differences; guesses that are so near, squared, are one."""
AFAR_MM, _END_MM = LOW[PLACE], 50.0
"""So far before the lump there is none, as far as the emulator knows; so far away the solver is asked."""
_FIRST, _AGAIN, _PLAIN = Alike(2.0, 0.25, 0.2), Alike(5.0, 0.35, 0.4), Alike(12.0, 0.08, 0.1)
"""The solver is asked about the frames themselves, but for those so like another: of a first guess, of
others, and without a lump. Of a first guess it gives derivatives, too, as far apart as other guesses'."""
_ALL, _ALONG = 0.01, ((0.004, 1.2), (0.004, 2.5), (0.005, 10.0))
_LN_F = 0.8
_OF_THE_MESH = 0.0003
"""The spreads of corrections: of all frames alike, along the stroke by mm, by the logarithm of the force, and
of what the contact's nodes make of a single frame."""
_LARGER = 0.1, 0.3, 1.0, 2.0, 4.0, 8.0
"""So much larger they may be, all alike: as is likeliest."""
_SIDES_MM, _LEAST_MM = (4.0, 9.0, 14.0, 20.0, 28.0, 40.0), 2.0
"""Near there, so far apart, the lump's sides are compared: tissue ends nearer behind it than before it."""
_LUMP, _SOME_LUMP = [0, 1, 3], (np.log(8.0), np.log(8.0), 0.3)


@lru_cache(maxsize=1)
def bundled() -> PlaneEmulator:
    """The emulator that comes with Palpate."""
    return read_plane_emulator(models.plane_emulator_path())


class _Smooth:
    """A Gaussian process from frame to frame, over place and force, through values of m frames.

    What the mesh makes of a single frame is no part of it. Values come in parts (m, q), each as smooth as is
    likeliest.
    """

    def __init__(self, places_mm: Floats, ln_F: Floats, *parts: Floats) -> None:
        self._own = places_mm, ln_F
        K = _kernel(*self._own, *self._own)[0]
        self._weights = np.concatenate([_smoothed(K, part) for part in parts], 1)

    def __call__(self, before: Floats, ln_F: Floats) -> Floats:
        """Of frames (n,), part after part, and derivatives by place and ln F, (3, n, q)."""
        out: Floats = np.array([part @ self._weights for part in _kernel(before, ln_F, *self._own)])
        return out


@dataclass(frozen=True)
class _Correction:
    """What the solver says otherwise of one guess: rows over the mean pressure, ln displacement.

    Attributes
    ----------
    parts : tuple of _Smooth
        To be added up: of the first guess, and what others have changed.
    """

    theta: Floats
    parts: tuple[_Smooth, ...]

    def __call__(self, before: Floats, ln_F: Floats) -> Floats:
        """As `_Smooth`."""
        out: Floats = sum(part(before, ln_F) for part in self.parts)  # type: ignore[assignment]
        return out


def _kernel(x: Floats, ln_F: Floats, x2: Floats, ln_F2: Floats) -> tuple[Floats, Floats, Floats]:
    """Covariances (n, m) of corrections, and their derivatives by the first place and force."""
    u, v = (np.clip(one, -_END_MM, _END_MM) for one in (x[:, None], x2))
    moves = np.where(np.abs(x) < _END_MM, 1.0, 0.0)[:, None]
    apart = u - v
    shapes = [(sd**2 * np.exp(-((apart / length) ** 2) / 2), length) for sd, length in _ALONG]
    along = _ALL**2 + sum(shape for shape, _ in shapes)
    slope = moves * sum(-apart / length**2 * shape for shape, length in shapes)
    off = (ln_F[:, None] - ln_F2) / _LN_F
    force = np.exp(-(off**2) / 2)
    return along * force, slope * force, -along * force * off / _LN_F


def _smoothed(K: Floats, values: Floats) -> Floats:
    """Weights (m, q) of a Gaussian process through values (m, q), as smooth as is likeliest."""
    best = np.inf, values
    for times in _LARGER:
        L = np.linalg.cholesky(times**2 * K + _OF_THE_MESH**2 * np.eye(len(K)))
        weights = np.linalg.solve(L.T, np.linalg.solve(L, values))
        spread = float((values * weights).mean()) + 1e-30
        unlikely = len(K) * float(np.log(spread)) + 2 * float(np.log(np.diag(L)).sum())
        if unlikely < best[0]:
            best = unlikely, times**2 * weights
    return best[1]


class EmulatedForward(SaysSlopes):
    """Emulates frames of one class, under the usual face.

    Parameters
    ----------
    strokes : sequence of (int, int)
        How many frames each stroke has, and how many of them are its press.
    """

    def __init__(self, of: Class, strokes: Sequence[tuple[int, int]]) -> None:
        self.of, self.strokes = of, tuple(strokes)
        self.scale = of.scale
        self._stroke = np.repeat(np.arange(len(strokes)), [frames for frames, _ in strokes])
        self._press = np.concatenate([np.arange(frames) < press for frames, press in strokes])
        self._emulator = bundled()
        self._right: list[_Correction] = []
        self._solves = Solves(of, MESH)
        self._turns: _Smooth | None = None
        self._behind: CubicSpline | None = None

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
        if self._right:
            more, by_more = self._corrections(theta, places_mm, ln_F)
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
        frames = Frames(np.clip(before, -_END_MM, _END_MM), ln_F, way)
        alike = _PLAIN if not self.of.lump else _AGAIN if self._right else _FIRST
        solved = self._solves(theta, frames, alike)
        places, asked_F = solved.places_mm, np.log(solved.forces_N_per_m / FAT_KPA)
        if self.of.lump and self._behind is None:
            self._behind = _other_side(self.of.case(theta), solved, float(places_mm.max()))
        y = self._frames(self._inputs(theta)[0], places, asked_F)[0]
        if self._turns is None and self.of.lump:
            self._turns = self._turned_by(theta, solved)
        known = self._right[-1].parts if self._right else ()
        wrong = _values(solved) - y - sum(part(places, asked_F)[0] for part in known)
        self._right.append(_Correction(theta.copy(), (*known, _Smooth(places, asked_F, wrong))))

    def _turned_by(self, theta: Floats, solved: SolvedFrames) -> _Smooth:
        """What the solver's derivatives by the unknowns are otherwise, unknown after unknown."""
        some, found = self._solves.steep(solved, _AGAIN)
        places, F = some.places_mm, some.forces_N_per_m
        of_depth = found.displacement / some.displacement_mm[:, None]
        by = np.concatenate([found.images * _FACE_MM / F[:, None, None], of_depth[:, None]], 1)
        base, chain = self._inputs(theta)
        there = places, np.log(F / FAT_KPA)
        emulated = self._frames(base, *there)[1][..., :PLACE] @ chain
        wrong = by[..., :-2] @ self.of.chain(theta) - emulated
        return _Smooth(*there, *np.moveaxis(wrong, -1, 0))

    def like(self, other: EmulatedForward) -> None:
        """Behind the lump tissue is as another guess of the same strokes has it: that varies little."""
        if self._behind is None:
            self._behind = other._behind

    def go_back(self) -> None:
        """The last guess but one is the better one; what the last has told is kept."""
        self._right[-2:] = self._right[:-3:-1]

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
            y[behind] += self._behind(np.minimum(places_mm[behind], _END_MM))
        by[behind, :ROWS] = by[behind, :ROWS][:, ::-1]
        by[behind, :, PLACE] *= -1
        if not self.of.lump:
            by[..., PLACE] = 0.0
        return y, by

    def _corrections(self, theta: Floats, places_mm: Floats, ln_F: Floats) -> tuple[Floats, Floats]:
        """To be added to frames (n, 17), and derivatives (n, 17, k + 2) by the unknowns, place and ln F."""
        last, (before, behind) = self._right[-1], self._before(places_mm)
        said = right = last(before, ln_F)
        slopes = np.zeros((*right[0].shape, len(theta)))
        if self._turns is not None:
            turns = self._turns(before, ln_F).reshape(3, len(before), len(theta), -1).swapaxes(2, 3)
            right, slopes = right + turns @ (theta - last.theta), turns[0]
        if len(self._right) > 1:  # along the way from one guess to another it turns as they say
            other = self._right[-2]
            step = last.theta - other.theta
            way = step / self.of.column("sd") ** 2
            way /= way @ step + _NO_WAY
            more = said - other(before, ln_F)
            if self._turns is not None:
                more -= turns @ step
            share = float(way @ (theta - last.theta))
            right = right + np.clip(share, -1.0, 1.0) * more
            slopes = slopes + (abs(share) < 1.0) * more[0][..., None] * way
        out, by_place, by_force = right
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
    return np.column_stack([_shares(solved), np.log(solved.displacement_mm)])


def _shares(solved: SolvedFrames) -> Floats:
    """Rows over the mean pressure, (n, 16)."""
    return solved.images_kPa * _FACE_MM / solved.forces_N_per_m[:, None]


def _turned(frames: Floats) -> Floats:
    """Frames (n, 17) on the other side of the lump."""
    return np.concatenate([frames[:, :ROWS][:, ::-1], frames[:, ROWS:]], 1)
