"""The forward model of solid lumps: an emulator of computed strokes, set right by the solver.

The emulator's derivatives are smooth, the solver's are not: nodes enter and leave the contact. So the search
goes by the emulator, and what the solver says otherwise at one guess is added to it from then on. What it
may still get wrong are further unknowns of the class (`solid_classes.learnt`).

In fat of 10 kPa. Units: mm, kPa, N/m. A table has the stroke's images, position by position from before the
lump to over it, and its displacements; a frame's image is binned, `BINS`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from palpate import models
from palpate.inversion.classes import FAT_KPA, Class
from palpate.inversion.felt import FeltStroke
from palpate.inversion.forward import Emulated, SaysSlopes, Slopes
from palpate.learn.emulator import NO_CONTACT, OFFSET, ON_LINE_MM, Parts, StrokeEmulator, inputs_of, unsigned
from palpate.learn.emulator_file import Errors, read_emulator
from palpate.learn.gaussian_process import GaussianProcess
from palpate.sim.tissue import Case
from palpate.sim.tissue.any_tissue import FORCE_PARTS
from palpate.sim.tissue.solid.stroke import RAMP, simulate_forces

Floats = NDArray[np.float64]

BINS = (16, 13)
"""Rows, and pairs of columns."""
_CELLS = (16, 26)
_NODES = np.log(FORCE_PARTS)
_STEP = 1e-6
_GRID = 0.1
"""Steps of the logarithm of the force in the middle of an emulated stroke's three."""
_UNFELT = 2.0
"""E over the fat's of the lump that stands for none: the emulator has always met one, which a press so far
from it hardly feels."""
_STILL_WRONG = 0.35
"""What is left of the emulator's errors where the solver has set it right nearby."""


@lru_cache(maxsize=1)
def bundled() -> tuple[StrokeEmulator, Errors]:
    """The emulator that comes with Palpate, and what it gets wrong."""
    return read_emulator(models.emulator_path())


@dataclass(frozen=True)
class Correction:
    """What the solver says otherwise than the emulator, at one guess.

    Attributes
    ----------
    case : Case
        At the middle of the three forces.
    image : ndarray (3, positions, cells); (3, 1, cells) without a lump
        Over the force, at `FORCE_PARTS` of the middle one.
    depth : ndarray (3, positions) or (3, 1)
        Of the displacement, over itself.
    ramp_image, ramp_depth : ndarray (5, cells), (5,)
        At the first position, at rising forces from the ramp's on.
    cpu_s : float
    """

    case: Case
    image: Floats
    depth: Floats
    ramp_image: Floats
    ramp_depth: Floats
    cpu_s: float = 0.0

    @property
    def middle(self) -> float:
        """ln of the middle force over the fat's modulus."""
        return float(np.log(self.case.F_N_per_m / self.case.fat_kPa))


def correction_at(case: Case, emulator: StrokeEmulator) -> Correction:
    """Compute the strokes of one guess, at three forces about its own; a press alone where there is no lump.

    Raises
    ------
    CaseError, StrokeError
        There is no such lump, or no equilibrium.
    """
    if abs(case.offset_mm) < ON_LINE_MM:  # that costs the solver a quarter
        case = replace(case, offset_mm=0.0)
    forces = [case.F_rel * part for part in FORCE_PARTS]
    positions = _positions(emulator, case.has_lump)
    found = simulate_forces(case, forces, positions_mm=positions.tolist(), ramp=True)
    unit = np.array([one.case.F_N_per_m for one in found])
    x = np.array([_inputs_of(one.case) for one in found])
    images, depths = emulator.pressed(x)
    if case.has_lump:
        images, depths = emulator.stroked(x, images, depths)
    else:
        images, depths = images[:, None], depths[:, None]
    computed = np.array([one.images_kPa for one in found])
    image = (computed - images).reshape(len(found), len(positions), -1) / unit[:, None, None]
    depth = np.array([one.displacement_mm for one in found]) / depths - 1
    low = np.repeat(x[:1], len(RAMP), axis=0)
    low[:, -1] += np.log(RAMP)
    low_images, low_depths = emulator.pressed(low)
    ramp = (found[0].ramp_images_kPa - low_images).reshape(len(RAMP), -1)
    ramp = ramp / (unit[0] * np.array(RAMP))[:, None]
    return Correction(
        case, image, depth, np.concatenate([ramp, image[:, 0]]),
        np.concatenate([found[0].ramp_displacement_mm / low_depths - 1, depth[:, 0]]),
        sum(one.cpu_s for one in found),
    )  # fmt: skip


class SolidForward(SaysSlopes):
    """Emulates frames of one class.

    Parameters
    ----------
    of : Class
        With unknowns for the emulator's errors behind its own.
    press : int
        So many of the first frames stand where the stroke begins.
    correction : Correction, optional
        What the solver has said near the guesses.
    """

    def __init__(self, of: Class, press: int, correction: Correction | None = None) -> None:
        self.of, self.press, self.correction = of, press, correction
        self.emulator, self.errors = bundled()
        self.positions_mm = _positions(self.emulator, of.lump)
        image = self.errors.image
        self._wrong_image = _binned(image.reshape(*image.shape[:2], *_CELLS))
        self.scale = of.scale

    def __call__(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> Emulated:
        """Frames (n,) of a guess.

        Raises
        ------
        CaseError
            There is no such tissue.
        """
        p, n = self.press, len(places_mm)
        own = len(theta) - len(self.errors.image)
        base, chain = self._inputs(theta, own)
        ln_force = np.log(forces_N_per_m / FAT_KPA)
        # it stays while forces change a little, so that slopes by each force are all there is
        middle = _GRID * round(float(ln_force[p:].mean()) / _GRID)
        middle = middle if self.correction is None else self.correction.middle
        levels = np.concatenate([ln_force[:p], middle + _NODES])
        x = np.column_stack([np.tile(base, (len(levels), 1)), levels])
        tables, deep, of_tables, of_deep = self._tables(x, chain, theta[own:], levels - middle)
        weights, steep = _along(self.positions_mm, places_mm)
        # the press is emulated at its frames' own forces, the stroke between three
        shares = np.zeros((n, len(levels)))
        by_force = np.zeros((n, len(levels)))
        shares[np.arange(p), np.arange(p)] = 1.0
        shares[p:, p:], by_force[p:, p:] = _between(middle + _NODES, ln_force[p:])
        k = len(theta)
        images = np.einsum("nm,nx,mxc->nc", shares, weights, tables, optimize=True)
        depth = np.einsum("nm,nx,mx->n", shares, weights, deep, optimize=True)
        of_image = np.empty((n, images.shape[1], k + 2))
        of_depth = np.empty((n, k + 2))
        of_image[:, :, :k] = np.einsum("nm,nx,mxck->nck", shares, weights, of_tables[..., :k], optimize=True)
        of_depth[:, :k] = np.einsum("nm,nx,mxk->nk", shares, weights, of_deep[..., :k], optimize=True)
        of_image[:, :, k] = np.einsum("nm,nx,mxc->nc", shares, steep, tables, optimize=True)
        of_depth[:, k] = np.einsum("nm,nx,mx->n", shares, steep, deep, optimize=True)
        of_image[:, :, k + 1] = np.einsum("nm,nx,mxc->nc", by_force, weights, tables, optimize=True)
        of_depth[:, k + 1] = np.einsum("nm,nx,mx->n", by_force, weights, deep, optimize=True)
        # of a press' frame the force is its table's own
        of_image[:p, :, k + 1] = np.einsum("nx,nxc->nc", weights[:p], of_tables[:p, ..., k], optimize=True)
        of_depth[:p, k + 1] = np.einsum("nx,nx->n", weights[:p], of_deep[:p, ..., k], optimize=True)
        return Emulated(theta, places_mm, forces_N_per_m, images, depth, Slopes(of_image, of_depth))

    def _inputs(self, theta: Floats, own: int) -> tuple[Floats, Floats]:
        """The emulator's inputs but for the force, (13,), and their derivatives by the unknowns."""

        def inputs(t: Floats) -> Floats:
            return np.array(_inputs_of(self.of.case(t))[:-1])

        steps = _STEP * np.eye(len(theta))[:own]
        apart = [inputs(theta + step) - inputs(theta - step) for step in steps]
        return inputs(theta), np.array(apart).T / (2 * _STEP)

    def _tables(
        self, x: Floats, chain: Floats, wrong: Floats, over_middle: Floats
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Binned images (m, 2 n - 1, bins) and displacements (m, 2 n - 1) at inputs x (m, 14).

        On both sides of the lump, and their derivatives (..., k + 1) by tissue, lump and errors, then ln
        force.
        """
        image, of_image, depth, of_depth = _emulated(self.emulator, x, self.of.lump)
        m, p, places, own = len(x), self.press, len(self.positions_mm), chain.shape[1]
        image = image.reshape(m, places, *_CELLS)
        of_image = of_image.reshape(m, places, *_CELLS, -1)
        image, of_image = _binned(image), _binned(of_image)
        force = FAT_KPA * np.exp(x[:, -1])
        k = own + len(wrong)
        of_both = np.zeros((*image.shape, k + 1))
        of_both[..., :own] = of_image[..., :-1] @ chain
        of_both[..., k] = of_image[..., -1]
        of_deep = np.zeros((*depth.shape, k + 1))
        of_deep[..., :own] = of_depth[..., :-1] @ chain
        of_deep[..., k] = of_depth[..., -1]
        parts, steep, deep_parts, deep_steep = self._wrong(over_middle)
        more, longer = parts @ wrong, 1 + deep_parts @ wrong
        steep, deep_steep = steep @ wrong, deep_steep @ wrong
        if self.correction is not None:
            right = _set_right(self.correction, over_middle, p)
            for of, one in zip((more, steep, longer, deep_steep), right):
                of += one
        of_both[..., own:k] = force[:, None, None, None] * parts
        more *= force[:, None, None]
        image = image + more
        of_both[..., k] += more
        of_both[:p, ..., k] += (force[:p, None] * steep)[:, None]
        of_deep = of_deep * longer[..., None]
        of_deep[..., own:k] += deep_parts * depth[..., None]
        of_deep[:p, :, k] += deep_steep[:, None] * depth[:p]
        depth = depth * longer
        images = (_mirrored(one, True) for one in (image, of_both))
        depths = (_mirrored(one, False) for one in (depth, of_deep))
        (image, of_both), (depth, of_deep) = images, depths
        return image, depth, of_both, of_deep

    def _wrong(self, over_middle: Floats) -> list[Floats]:
        """As `_at_levels`: components (..., j) of what the emulator gets wrong, images over the force."""
        errors, places = self.errors, len(self.positions_mm)
        less = 1.0 if self.correction is None else _STILL_WRONG
        press = np.append(np.arange(len(self.emulator.positions_mm), errors.image.shape[1]), 0)
        nodes = np.append(np.log(RAMP) + _NODES[0], 0.0)
        out: list[Floats] = []
        for of in (self._wrong_image, errors.depth):
            table = less * np.moveaxis(of, 0, -1)
            stroke = np.repeat(table[None, :places], len(_NODES), axis=0)
            out += _at_levels(over_middle[: self.press], nodes, table[press], stroke)
        return out


class OverOneLump(SaysSlopes):
    """Emulates the frames of several strokes over one lump, stroke by stroke.

    Parameters
    ----------
    each : sequence of Class
        As each stroke feels it.
    strokes : sequence of FeltStroke
    corrections : sequence of Correction, optional
        One for each stroke.
    """

    def __init__(
        self, each: Sequence[Class], strokes: Sequence[FeltStroke], corrections: Sequence[Correction] = ()
    ) -> None:
        own: Sequence[Correction | None] = corrections or [None] * len(strokes)
        self._parts = [SolidForward(of, felt.press, one) for of, felt, one in zip(each, strokes, own)]
        self._ends = np.cumsum([0, *(len(stroke.place_mm) for stroke in strokes)])
        self.scale = each[0].scale

    def __call__(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> Emulated:
        """As `SolidForward`."""
        each = [
            part(theta, places_mm[a:b], forces_N_per_m[a:b])
            for part, (a, b) in zip(self._parts, pairwise(self._ends))
        ]
        slopes = [one.slopes for one in each]
        return Emulated(
            theta, places_mm, forces_N_per_m,
            np.concatenate([one.images for one in each]), np.concatenate([one.depth for one in each]),
            Slopes(np.concatenate([s.images for s in slopes]), np.concatenate([s.depth for s in slopes])),
        )  # fmt: skip


def _positions(of: StrokeEmulator, lump: bool) -> Floats:
    """Where a stroke's tables stand; without a lump it is alike all along."""
    return of.positions_mm if lump else of.positions_mm[:1]


def _inputs_of(case: Case) -> list[float]:
    """As the emulator's `inputs_of`."""
    return inputs_of(case if case.has_lump else replace(case, E_ratio=_UNFELT))


def _set_right(of: Correction, over_middle: Floats, press: int) -> list[Floats]:
    """As `_at_levels`: what the solver says otherwise, images over the force, and displacements."""
    nodes = np.append(np.log(RAMP) + _NODES[0], _NODES)
    images = [_binned(one.reshape(*one.shape[:-1], *_CELLS)) for one in (of.ramp_image, of.image)]
    pairs = (images, (of.ramp_depth, of.depth))
    return [one for pair in pairs for one in _at_levels(over_middle[:press], nodes, *pair)]


def _at_levels(at: Floats, nodes: Floats, press: Floats, stroke: Floats) -> tuple[Floats, Floats]:
    """Tables at a press' forces, logarithms (p,), linear between nodes (r,), and at a stroke's.

    Parameters
    ----------
    press : ndarray (r, ...)
        At the nodes, wherever it stands.
    stroke : ndarray (3, positions, ...)

    Returns
    -------
    tables : ndarray (p + 3, positions, ...)
    slopes : ndarray (p, ...)
        Of the press', by the logarithm of its force.
    """
    k = np.clip(np.searchsorted(nodes, at) - 1, 0, len(nodes) - 2)
    width = np.diff(nodes)[k]
    share = np.clip((at - nodes[k]) / width, 0.0, 1.0)
    within = (at >= nodes[0]) & (at <= nodes[-1])
    eye = np.eye(len(nodes))
    shares = (1 - share)[:, None] * eye[k] + share[:, None] * eye[k + 1]
    steep = (within / width)[:, None] * (eye[k + 1] - eye[k])
    own = np.tensordot(shares, press, 1)
    tables = np.concatenate([np.repeat(own[:, None], stroke.shape[1], axis=1), stroke])
    return tables, np.tensordot(steep, press, 1)


def _emulated(of: StrokeEmulator, x: Floats, lump: bool) -> tuple[Floats, Floats, Floats, Floats]:
    """Images (m, positions, cells) and displacements (m, positions), each followed by its slopes (..., 14).

    As `StrokeEmulator.pressed` and `stroked`.
    """
    m, inputs = x.shape
    shapes, of_shapes = _parts(of.press, x)
    touched = shapes >= NO_CONTACT
    shapes, of_shapes = shapes * touched, of_shapes * touched[..., None]
    ln_mean, of_mean = of.ln_mean.with_slopes(x)
    of_mean[:, -1] += 1.0
    mean = np.exp(ln_mean + x[:, -1])
    whole = shapes.mean(1)
    scale = mean / whole
    of_scale = scale[:, None] * (of_mean - of_shapes.mean(1) / whole[:, None])
    first = shapes * scale[:, None]
    of_first = of_shapes * scale[:, None, None] + shapes[..., None] * of_scale[:, None]
    ln_depth, of_depth = of.ln_depth.with_slopes(x)
    depth = np.exp(ln_depth)
    if not lump:
        return first[:, None], of_first[:, None], depth[:, None], (depth[:, None] * of_depth)[:, None]
    mean, of_mean = first.mean(1), of_first.mean(1)

    bump, of_bump = _sized(of.bump, of.ln_bump, x)
    places = len(of.positions_mm) - 1
    bump, of_bump = bump.reshape(m, places, -1), of_bump.reshape(m, places, -1, inputs)
    on = first[:, None] + mean[:, None, None] * bump
    of_on = of_first[:, None] + mean[:, None, None, None] * of_bump
    of_on += of_mean[:, None, None] * bump[..., None]
    held = on > 0
    on, of_on = on * held, of_on * held[..., None]
    # the hand's force is the same all along
    there = on.mean(2)
    scale = mean[:, None] / there
    of_scale = scale[..., None] * (of_mean[:, None] / mean[:, None, None] - of_on.mean(2) / there[..., None])
    of_on = of_on * scale[..., None, None] + on[..., None] * of_scale[:, :, None]
    on = on * scale[..., None]
    image = np.concatenate([first[:, None], on], 1)
    of_image = np.concatenate([of_first[:, None], of_on], 1)

    dip, of_dip = _sized(of.dip, of.ln_dip, x)
    along = np.column_stack([np.ones(m), 1 + dip])
    of_along = np.concatenate([np.zeros((m, 1, inputs)), of_dip], 1)
    deep = depth[:, None] * along
    of_deep = deep[..., None] * of_depth[:, None] + depth[:, None, None] * of_along
    return image, of_image, deep, of_deep


def _parts(of: Parts, x: Floats) -> tuple[Floats, Floats]:
    each = [process.with_slopes(x) for process in of.processes]
    scores, slopes = np.stack([v for v, _ in each], 1), np.stack([s for _, s in each], 1)
    return of.mean + scores @ of.parts, np.einsum("mjk,jc->mck", slopes, of.parts, optimize=True)


def _sized(of: Parts, ln_size: GaussianProcess, x: Floats) -> tuple[Floats, Floats]:
    """What the lump changes, and its slopes: parts over a size that the lump's side does not matter to."""
    ln, of_ln = ln_size.with_slopes(unsigned(x))
    of_ln[:, OFFSET] *= np.sign(x[:, OFFSET])
    values, slopes = _parts(of, x)
    size = np.exp(ln)
    values = values * size[:, None]
    return values, slopes * size[:, None, None] + values[..., None] * of_ln[:, None]


def _binned(cells: Floats) -> Floats:
    """Cells (..., 16, 26) or (m, n, 16, 26, k) as means of `BINS`, in one axis."""
    slopes = cells.shape[2:4] == _CELLS and cells.ndim == 5
    shape = cells.shape[:2] if slopes else cells.shape[:-2]
    rest = cells.shape[4:] if slopes else ()
    pairs = cells.reshape(*shape, BINS[0] * BINS[1], 2, *rest)
    left, right = np.moveaxis(pairs, len(shape) + 1, 0)
    return 0.5 * (left + right)


def _mirrored(table: Floats, image: bool) -> Floats:
    """(m, n, ...) continued to the other side of the lump, (m, 2 n - 1, ...); images turn round."""
    if table.shape[1] == 1:
        return table
    other = table[:, :-1][:, ::-1]
    if image:
        m, n, _, *rest = other.shape
        other = other.reshape(m, n, *BINS, *rest)[:, :, ::-1].reshape(m, n, -1, *rest)
    return np.concatenate([table, other], 1)


def _along(positions_mm: Floats, places_mm: Floats) -> tuple[Floats, Floats]:
    """Shares (n, 2 p - 1) of the positions' tables at places (n,) by a cubic spline, and their derivatives.

    Beyond the first position all stays as it is.
    """
    if len(positions_mm) == 1:
        return np.ones((len(places_mm), 1)), np.zeros((len(places_mm), 1))
    both = np.append(positions_mm, -positions_mm[:-1][::-1])
    spline = CubicSpline(both, np.eye(len(both)))
    within = np.clip(places_mm, both[0], both[-1])
    slope: Floats = spline(within, 1) * (within == places_mm)[:, None]
    return spline(within), slope


def _between(nodes: Floats, at: Floats) -> tuple[Floats, Floats]:
    """Shares (n, 3) of the parabola through three nodes at (n,), and their derivatives."""
    shares = np.ones((len(at), 3))
    slopes = np.zeros((len(at), 3))
    for i in range(3):
        j, k = (other for other in range(3) if other != i)
        below = (nodes[i] - nodes[j]) * (nodes[i] - nodes[k])
        shares[:, i] = (at - nodes[j]) * (at - nodes[k]) / below
        slopes[:, i] = (2 * at - nodes[j] - nodes[k]) / below
    return shares, slopes
