"""Strokes over solid lumps that nobody has computed, from those that were: seconds for thousands.

A stroke over a solid lump takes the solver a quarter of a minute, and a model needs thousands of lumps. But
what the probe feels changes evenly with lump, tissue and force: so images and displacements are taken apart
into a few principal components, and each is learnt by a Gaussian process. Two things are learnt apart, since
one is a hundred times the other: the press over the tissue, and what the lump then changes of it.

Lumps that a model is judged on are always computed ones, and ones that the emulator has not seen.
Units: mm, kPa, N/m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.features.map_features import Floats
from palpate.learn.gaussian_process import GaussianProcess, fit_process
from palpate.learn.lumps import LumpStrokes
from palpate.sim.tissue import Case
from palpate.sim.tissue.solid.press import felt
from palpate.sim.tissue.solid.stroke import RAMP

OFFSET = 11
"""Of `inputs_of`: mirrored lumps differ in its sign. Few lumps lie beside the line, each on its own mesh;
this must not pass for a wave across the line, or searches stay where they begin."""
ON_LINE_MM = 1.5
"""Nearer to the line a lump counts as on it: those are computed on half a mesh."""

_PRESS_PARTS, _LUMP_PARTS, _DIP_PARTS = (20, 0.9999999), (24, 0.9995), (4, 0.9999)
"""Principal components: how many at most, and the share of variance that is enough. What ten of the press
left out was half of all errors."""

_LEAST = 1e-4
"""Of what the lump changes, over the press, beside which it counts as nothing."""
NO_CONTACT = 2e-3
"""Of the mean pressure: cells under it do not touch the skin."""


@dataclass(frozen=True)
class Parts:
    """Principal components of rows, (parts, cells) about their mean, with a process for each."""

    mean: Floats
    parts: Floats
    processes: tuple[GaussianProcess, ...]

    def predict(self, x: Floats) -> Floats:
        """(n, cells) at inputs x (n, inputs)."""
        found = np.column_stack([process.predict(x) for process in self.processes])
        out: Floats = self.mean + found @ self.parts
        return out


@dataclass(frozen=True)
class StrokeEmulator:
    """Fitted by `fit_emulator`: of the press, ln displacement, image over its mean, and ln mean pressure over
    force; of the lump, what it changes along the stroke of image and displacement, over sizes learnt first.
    """

    positions_mm: Floats
    shape: tuple[int, ...]
    ln_depth: GaussianProcess
    ln_mean: GaussianProcess
    press: Parts
    ln_bump: GaussianProcess
    bump: Parts
    ln_dip: GaussianProcess
    dip: Parts

    def lumps(self, cases: Sequence[Case]) -> list[LumpStrokes]:
        """The lumps of a design such as `ball_cases`: three cases each, at rising forces."""
        ramp = [replace(first, F_rel=part * first.F_rel) for first in cases[:: len(_FORCES)] for part in RAMP]
        x = np.array([inputs_of(case) for case in cases])
        images, depths = self.pressed(x)
        ramp_images, ramp_depths = self.pressed(np.array([inputs_of(case) for case in ramp]))
        strokes = [
            felt(case, self.positions_mm, depth, image)
            for case, image, depth in zip(cases, *self.stroked(x, images, depths), strict=True)
        ]
        at = self.positions_mm[:1]
        presses = [
            felt(case, at, depth[None], image[None])
            for case, depth, image in zip(ramp, ramp_depths, ramp_images, strict=True)
        ]
        out = []
        for k in range(len(cases) // len(_FORCES)):
            own = strokes[len(_FORCES) * k : len(_FORCES) * (k + 1)]
            press = presses[len(RAMP) * k : len(RAMP) * (k + 1)]
            press += [felt(s.case, at, s.displacement_mm[:1], s.images_kPa[:1]) for s in own]
            out.append(LumpStrokes(tuple(own), tuple(press)))
        return out

    def learnt(self, k: int) -> tuple[float, float]:
        """Least and greatest of one of `inputs_of`, a logarithm, that it was fitted to; the number itself."""
        of = self.ln_depth
        seen = np.exp(of.z[:, k] * of.scale[k] + of.centre[k])
        return float(seen.min()), float(seen.max())

    def pressed(self, x: Floats) -> tuple[Floats, Floats]:
        """Images (n, rows, columns) and displacements (n,) where strokes begin."""
        shapes = self.press.predict(x)
        shapes[shapes < NO_CONTACT] = 0.0
        mean = np.exp(self.ln_mean.predict(x) + x[:, -1])
        images = shapes * (mean / shapes.mean(1))[:, None]
        return images.reshape(-1, *self.shape), np.exp(self.ln_depth.predict(x))

    def stroked(self, x: Floats, images: Floats, depths: Floats) -> tuple[Floats, Floats]:
        """Images (n, positions, rows, columns) and displacements (n, positions) from those of the press."""
        n, places = len(x), len(self.positions_mm) - 1
        first = images.reshape(n, 1, -1)
        mean = first.mean(2, keepdims=True)
        bump = self.bump.predict(x) * np.exp(self.ln_bump.predict(unsigned(x)))[:, None]
        on = np.maximum(first + mean * bump.reshape(n, places, -1), 0.0)
        # the hand's force is the same all along
        on *= mean / on.mean(2, keepdims=True)
        dip = self.dip.predict(x) * np.exp(self.ln_dip.predict(unsigned(x)))[:, None]
        depth = depths[:, None] * np.column_stack([np.ones(n), 1 + dip])
        return np.concatenate([first, on], axis=1).reshape(n, places + 1, *self.shape), depth


_FORCES = (0, 1, 2)
"""Of each lump."""


def fit_emulator(lumps: Sequence[LumpStrokes]) -> StrokeEmulator:
    """Learn from computed strokes; those of lumps beside the line also stand for their mirror images."""
    both = [*lumps, *(lump.mirrored() for lump in lumps if lump.case.offset_mm)]
    presses = [stroke for lump in both for stroke in lump.press]
    strokes = [stroke for lump in both for stroke in lump.strokes]
    x = np.array([inputs_of(stroke.case) for stroke in presses])
    images = np.array([stroke.images_kPa[0].ravel() for stroke in presses])
    depth = np.array([stroke.displacement_mm[0] for stroke in presses])
    mean = images.mean(1)
    ln_mean = fit_process(x, np.log(mean) - x[:, -1])
    ln_depth = fit_process(x, np.log(depth))
    press = _fit_parts(x, images / mean[:, None], *_PRESS_PARTS)

    x = np.array([inputs_of(stroke.case) for stroke in strokes])
    bumps = np.array([_change(stroke.images_kPa) for stroke in strokes])
    dips = np.array([stroke.displacement_mm[1:] / stroke.displacement_mm[0] - 1 for stroke in strokes])
    (ln_bump, bump), (ln_dip, dip) = (
        _fit_change(x, of, *parts) for of, parts in ((bumps, _LUMP_PARTS), (dips, _DIP_PARTS))
    )
    one = strokes[0]
    return StrokeEmulator(
        one.positions_mm, one.images_kPa.shape[1:], ln_depth, ln_mean, press, ln_bump, bump, ln_dip, dip
    )


def _change(images_kPa: Floats) -> Floats:
    """What lies over the first image, over its mean, as one row."""
    first = images_kPa[0]
    out: Floats = ((images_kPa[1:] - first) / first.mean()).ravel()
    return out


def _fit_change(x: Floats, rows: Floats, most: int, share: float) -> tuple[GaussianProcess, Parts]:
    """ln of the rows' size, and the rows over the size that is expected."""
    size = np.sqrt((rows**2).mean(1))
    ln_size = fit_process(unsigned(x), np.log(size + _LEAST), smooth=(OFFSET,))
    expected = np.exp(ln_size.predict(unsigned(x)))
    return ln_size, _fit_parts(x, rows / expected[:, None], most, share)


def _fit_parts(x: Floats, rows: Floats, most: int, share: float) -> Parts:
    mean = rows.mean(0)
    _, spread, parts = np.linalg.svd(rows - mean, full_matrices=False)
    explained = np.cumsum(spread**2) / (spread**2).sum()
    parts = parts[: min(most, int(np.searchsorted(explained, share)) + 1)]
    scores = (rows - mean) @ parts.T
    return Parts(mean, parts, tuple(fit_process(x, score, smooth=(OFFSET,)) for score in scores.T))


def unsigned(x: Floats) -> Floats:
    """Inputs (n, 14) with all lumps on one side of the stroke's line."""
    out = x.copy()
    out[:, OFFSET] = np.abs(out[:, OFFSET])
    return out


def inputs_of(case: Case) -> list[float]:
    """What decides a stroke, lengths and ratios as logarithms; the force over the fat's modulus is last."""
    along, across, down = case.half_axes_mm
    return [
        *np.log([case.t_mm, case.depth_mm, along, across, down]),
        case.E_inv23,
        *np.log([case.gland_ratio, case.gland_mm]),
        case.fat_stiffening,
        case.gland_stiffening,
        case.probe_radius_mm / 10,
        case.offset_mm,
        float(np.exp(-((case.offset_mm / ON_LINE_MM) ** 2))),
        np.log(case.F_N_per_m / case.fat_kPa),
    ]
