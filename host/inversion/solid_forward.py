"""The forward model of solid lumps: an emulator of computed strokes, set right by the solver.

The emulator's derivatives are smooth, the solver's are not: nodes enter and leave the contact. So the search
goes by the emulator, and what the solver says otherwise at one guess and near it (`solid_correction`) is
added to it from then on. What it may still get wrong are further unknowns of the class
(`solid_classes.learnt`).

In fat of 10 kPa. Units: mm, kPa, N/m. A table has the stroke's images, position by position from before the
lump to over it, and its displacements; a frame's image is binned, `BINS`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from palpate.inversion.classes import FAT_KPA, Class, differences
from palpate.inversion.felt import FeltStroke
from palpate.inversion.forward import Emulated, SaysSlopes, Slopes
from palpate.inversion.solid_correction import NODES, RAMP_NODES, Correction, at_levels
from palpate.inversion.solid_emulator import BINS, binned_cells, bundled, emulated, inputs, positions

Floats = NDArray[np.float64]

_GRID = 0.1
"""Steps of the logarithm of the force in the middle of an emulated stroke's three."""
_STILL_WRONG = 0.35
"""What is left of the emulator's errors where the solver has set it right nearby."""


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
        self.positions_mm = positions(self.emulator, of.lump)
        self._wrong_image = binned_cells(self.errors.image)
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
        base = np.array(inputs(self.of.case(theta))[:-1])
        chain = differences(lambda t: inputs(self.of.case(t))[:-1], theta, own)
        ln_force = np.log(forces_N_per_m / FAT_KPA)
        # it stays while forces change a little, so that slopes by each force are all there is
        middle = _GRID * round(float(ln_force[p:].mean()) / _GRID)
        middle = middle if self.correction is None else self.correction.middle
        levels = np.concatenate([ln_force[:p], middle + NODES])
        x = np.column_stack([np.tile(base, (len(levels), 1)), levels])
        tables, deep, of_tables, of_deep = self._tables(x, chain, theta, levels - middle)
        weights, steep = _along(self.positions_mm, places_mm)
        # the press is emulated at its frames' own forces, the stroke between three
        shares = np.zeros((n, len(levels)))
        by_force = np.zeros((n, len(levels)))
        shares[np.arange(p), np.arange(p)] = 1.0
        shares[p:, p:], by_force[p:, p:] = _between(middle + NODES, ln_force[p:])
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

    def _tables(
        self, x: Floats, chain: Floats, theta: Floats, over_middle: Floats
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Binned images (m, 2 n - 1, bins) and displacements (m, 2 n - 1) at inputs x (m, 14).

        On both sides of the lump, and their derivatives (..., k + 1) by tissue, lump and errors, then ln
        force.
        """
        image, of_image, depth, of_depth = emulated(self.emulator, x, self.of.lump)
        p, own = self.press, chain.shape[1]
        wrong = theta[own:]
        image, of_image = binned_cells(image), binned_cells(of_image, -2)
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
        of_longer = np.zeros((*depth.shape, own))
        if (correction := self.correction) is not None:
            for to, one in zip((more, steep, longer, deep_steep), correction.at(over_middle, p)):
                to += one
            if sloping := correction.sloping(over_middle, p):
                away = correction.away(self.of.case(theta))
                of_away = differences(lambda t: correction.away(self.of.case(t)), theta, own)
                for to, one in zip((more, steep, longer, deep_steep), sloping):
                    to += one @ away
                of_both[..., :own] += force[:, None, None, None] * (sloping[0] @ of_away)
                of_longer = sloping[2] @ of_away
        of_both[..., own:k] = force[:, None, None, None] * parts
        more *= force[:, None, None]
        image = image + more
        of_both[..., k] += more
        of_both[:p, ..., k] += (force[:p, None] * steep)[:, None]
        of_deep = of_deep * longer[..., None]
        of_deep[..., :own] += of_longer * depth[..., None]
        of_deep[..., own:k] += deep_parts * depth[..., None]
        of_deep[:p, :, k] += deep_steep[:, None] * depth[:p]
        depth = depth * longer
        images = (_mirrored(one, True) for one in (image, of_both))
        depths = (_mirrored(one, False) for one in (depth, of_deep))
        (image, of_both), (depth, of_deep) = images, depths
        return image, depth, of_both, of_deep

    def _wrong(self, over_middle: Floats) -> list[Floats]:
        """As `at_levels`: components (..., j) of what the emulator gets wrong, images over the force."""
        errors, places = self.errors, len(self.positions_mm)
        less = 1.0 if self.correction is None else _STILL_WRONG
        press = np.append(np.arange(len(self.emulator.positions_mm), errors.image.shape[1]), 0)
        nodes = np.append(RAMP_NODES, 0.0)
        out: list[Floats] = []
        for of in (self._wrong_image, errors.depth):
            table = less * np.moveaxis(of, 0, -1)
            stroke = np.repeat(table[None, :places], len(NODES), axis=0)
            out += at_levels(over_middle[: self.press], nodes, table[press], stroke)
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
