"""The emulator of solid lumps with its derivatives, image and displacement at a time. Units: mm, kPa, N/m.

In fat of 10 kPa. A table has a stroke's images, position by position from before the lump to over it, and its
displacements.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate import models
from palpate.learn.emulator import NO_CONTACT, OFFSET, Parts, StrokeEmulator, inputs_of, unsigned
from palpate.learn.emulator_file import Errors, read_emulator
from palpate.learn.gaussian_process import GaussianProcess
from palpate.sim.tissue import Case

Floats = NDArray[np.float64]

BINS = (16, 13)
"""Rows, and pairs of columns."""
_UNFELT = 2.0
"""E over the fat's of the lump that stands for none: the emulator has always met one, which a press so far
from it hardly feels."""


@lru_cache(maxsize=1)
def bundled() -> tuple[StrokeEmulator, Errors]:
    """The emulator that comes with Palpate, and what it gets wrong."""
    return read_emulator(models.emulator_path())


def positions(of: StrokeEmulator, lump: bool) -> Floats:
    """Where a stroke's tables stand; without a lump it is alike all along."""
    return of.positions_mm if lump else of.positions_mm[:1]


def inputs(case: Case) -> list[float]:
    """As the emulator's `inputs_of`."""
    return inputs_of(case if case.has_lump else replace(case, E_ratio=_UNFELT))


def emulated(of: StrokeEmulator, x: Floats, lump: bool) -> tuple[Floats, Floats, Floats, Floats]:
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


def binned_cells(cells: Floats, axis: int = -1) -> Floats:
    """Cells along an axis as means of `BINS`."""
    axis %= cells.ndim
    pairs = cells.reshape(*cells.shape[:axis], -1, 2, *cells.shape[axis + 1 :])
    out: Floats = pairs.mean(axis + 1)
    return out
