"""The bound of a stroke over a ball or ellipsoid: derivatives are the emulator's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from palpate.features.map_features import Floats
from palpate.learn.emulator import StrokeEmulator, inputs_of
from palpate.learn.lumps import LumpStrokes
from palpate.learn.observed import noise_named
from palpate.learn.probe_model import HARD_BELOW
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue.symmetry import both_sides
from tests.studies.bound import MEDIAN_OF_SD, Bound, Felt, bound

FRAMES = 50
PRESS_PARTS = (0.25, 0.5, 1.0)
"""Of the force at which the press is looked at."""

_T, _DEPTH, _ALONG, _ACROSS, _DOWN, _E = range(6)
_OFFSET, _REACH = 11, 12

NAMES = (
    "ln d", "ln width", "ln depth", "ln down", "E^-2/3", "ln gland_ratio", "ln gland_mm", "b of the fat",
    "b of the gland", "radius / cm", "offset",
)  # fmt: skip
_PRIORS = (0.40, 0.45, 0.6, 0.45, 0.18, 0.46, 0.38, 0.87, 0.87, 0.115, 4.0, 0.37, 0.46)
"""Spreads over the design, of ln F and ln E_fat behind them."""
_STEPS = (0.05, 0.05, 0.05, 0.05, 0.02, 0.05, 0.05, 0.2, 0.2, 0.05, 0.3)
_MOVES = ((_ALONG,), (_ACROSS,), (_DEPTH,), (_DOWN,), (_E,), (6,), (7,), (8,), (9,), (10,), (_OFFSET,))
"""Of the emulator's inputs, by parameter; the fat's thickness follows depth and height."""


@dataclass(frozen=True)
class LumpBound:
    """What one stroke with its press tells of one lump, and the share of t that depth and height are."""

    lump: LumpStrokes
    bound: Bound
    of_t: dict[str, float]

    def sd(self, name: str) -> float:
        """Of one of `NAMES`, of ln F, ln E_fat or ln t."""
        return self.bound.sd_of(self.of_t if name == "ln t" else {name: 1.0})


def emulated_bound(emulator: StrokeEmulator, lump: LumpStrokes, noise: Noise | str) -> LumpBound:
    """The bound for one stroke with its press over this lump."""
    x = np.array(inputs_of(lump.case))
    derivatives = {}
    for k, (name, step) in enumerate(zip(NAMES, _STEPS, strict=True)):
        less, more = (_values(emulator, _changed(x, k, sign)) for sign in (-1, 1))
        derivatives[name] = (more - less) / (2 * step)
    less, more = (_values(emulator, _reached(x, sign)) for sign in (-1, 1))
    of_force = (more - less) / (2 * _STEPS[0])
    found = bound(_felt(emulator, x), derivatives, of_force, _PRIORS, noise_named(noise))
    depth, down = np.exp(x[_DEPTH]), np.exp(x[_DOWN])
    t = float(depth + down)
    return LumpBound(lump, found, {"ln depth": float(depth) / t, "ln down": float(down) / t})


def table_of(bounds: Sequence[LumpBound]) -> pd.DataFrame:
    """Median of the least median errors: all lumps, hard and soft ones, those clearly over the noise."""
    hard = np.array([one.lump.case.E_inv23 <= HARD_BELOW for one in bounds])
    small = np.array([one.lump.case.d_mm < 10 for one in bounds])
    deep_mm = np.array([one.lump.case.depth_mm for one in bounds])
    kinds = {
        "all": np.ones(len(bounds), bool),
        "hard": hard,
        "soft": ~hard,
        "under 10 mm": small,
        "over 10 mm deep": deep_mm > 10,
        "soft, under 10 mm, over 8 mm deep": small & (deep_mm > 8) & ~hard,
    }
    rows = []
    for words, which in kinds.items():
        of = [one for one, wanted in zip(bounds, which) if wanted]
        row: dict[str, object] = {"lumps of this kind": words, "lumps": len(of)}
        for name in ("ln d", "ln width", "ln depth", "ln t", "E^-2/3", "ln E_fat", "offset"):
            row[name] = float(np.median([MEDIAN_OF_SD * one.sd(name) for one in of]))
        if of:
            rows.append(row)
    return pd.DataFrame(rows)


def text_of(result: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Heads and rows."""
    heads = [
        "lumps of this kind",
        "lumps",
        "d",
        "width across",
        "depth",
        "t",
        "E^-2/3",
        "E_fat",
        "place across",
    ]
    rows = []
    for row in result.to_dict("records"):
        cells = [f"{100 * row[n]:.1f} %" for n in ("ln d", "ln width", "ln depth", "ln t")]
        cells += [f"{row['E^-2/3']:.3f}", f"{100 * row['ln E_fat']:.1f} %", f"{row['offset']:.2f} mm"]
        rows.append([str(row["lumps of this kind"]), str(row["lumps"]), *cells])
    return heads, rows


def _changed(x: Floats, parameter: int, sign: int) -> Floats:
    out = x.copy()
    out[list(_MOVES[parameter])] += sign * _STEPS[parameter]
    out[_T] = np.log(np.exp(out[_DEPTH]) + np.exp(out[_DOWN]))
    return out


def _reached(x: Floats, sign: int) -> Floats:
    out = x.copy()
    out[_REACH] += sign * _STEPS[0]
    return out


def _values(emulator: StrokeEmulator, x: Floats) -> Floats:
    """Pressures of all cells and the displacement, (frames, cells + 1): the press's, then the stroke's."""
    return _felt(emulator, x).values


def _felt(emulator: StrokeEmulator, x: Floats) -> Felt:
    press = np.repeat(x[None], len(PRESS_PARTS), axis=0)
    press[:, _REACH] += np.log(PRESS_PARTS)
    images, depths = emulator.pressed(press)
    stroke, along = emulator.stroked(x[None], images[-1:], depths[-1:])
    places, stroke, along = both_sides(emulator.positions_mm, stroke[0], along[0])
    spline = CubicSpline(places, np.column_stack([stroke.reshape(len(places), -1), along]))
    at = np.linspace(places[0], places[-1], FRAMES)
    pressed = np.column_stack([images.reshape(len(images), -1), depths])
    return Felt(
        np.concatenate([pressed, spline(at)]),
        np.concatenate([np.zeros_like(pressed), spline(at, 1)]),
        np.concatenate([np.full(len(pressed), places[0]), at]),
        np.arange(len(pressed) + FRAMES) < len(pressed),
        1,
    )
