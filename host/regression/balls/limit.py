"""What the images of a stroke themselves tell of a ball or ellipsoid: a bound, by Fisher's information.

Every cell in every frame of a stroke and of the press before it counts, whatever features an estimate may be
made of. Derivatives are those of the emulator. What else is not known (tissue, face, force and place of every
frame, the cells' gains and zeros) is estimated too, with what is known of it beforehand; the cells' own
disturbances enter as a covariance, inverted by Woodbury's formula. Nothing unbiased is surer.
Units: mm, kPa.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from palpate.features.map_features import Floats
from palpate.regression.any_tissue.observed import TissueLump
from palpate.regression.balls.emulator import StrokeEmulator, inputs_of
from palpate.regression.observed import noise_named
from palpate.regression.probe_model import HARD_BELOW
from palpate.sim.probe.cells import FULL_SCALE_KPA
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue.symmetry import both_sides

FRAMES = 50
PRESS_PARTS, PRESS_FRAMES = (0.25, 0.5, 1.0), 4
"""Of the force at which the press is looked at, and how many frames lie near each."""

_FORCE_SD = 0.05
"""Of a force that wanders by 10 % at most."""
_MEDIAN = 0.6745
"""Median of an error over its standard deviation."""
_T, _DEPTH, _ALONG, _ACROSS, _DOWN, _E = range(6)
_OFFSET, _REACH = 11, 12

NAMES = (
    "ln d", "ln width", "ln depth", "ln down", "E^-2/3", "ln gland_ratio", "ln gland_mm", "b of the fat",
    "b of the gland", "radius / cm", "offset", "ln F", "ln E_fat",
)  # fmt: skip
_PRIORS = (0.40, 0.45, 0.6, 0.45, 0.18, 0.46, 0.38, 0.87, 0.87, 0.115, 4.0, 0.37, 0.46)
"""Spreads over the design."""
_STEPS = (0.05, 0.05, 0.05, 0.05, 0.02, 0.05, 0.05, 0.2, 0.2, 0.05, 0.3)
_MOVES = ((_ALONG,), (_ACROSS,), (_DEPTH,), (_DOWN,), (_E,), (6,), (7,), (8,), (9,), (10,), (_OFFSET,))
"""Of the emulator's inputs, by parameter; the fat's thickness follows depth and height."""


@dataclass(frozen=True)
class Limit:
    """Standard deviations of d, width, depth, t and E_fat (relative), of E^-2/3, and of the place, mm."""

    lump: TissueLump
    sd: dict[str, float]


def limit_of(emulator: StrokeEmulator, lump: TissueLump, noise: Noise | str) -> Limit:
    """The bound for one stroke with its press over this lump."""
    level, x = noise_named(noise), np.array(inputs_of(lump.strokes.case))
    rows = [x, *(_changed(x, k, sign) for k in range(len(_MOVES)) for sign in (-1, 1))]
    rows += [_reached(x, sign) for sign in (-1, 1)]
    signals = [_signal(emulator, row) for row in rows]
    seen = signals[0]
    columns = [(signals[2 + 2 * k] - signals[1 + 2 * k]) / (2 * step) for k, step in enumerate(_STEPS)]
    of_force = (signals[-1] - signals[-2]) / (2 * _STEPS[0])
    # more modulus at the same force over it: all pressures rise, displacements stay
    of_fat = seen * (np.arange(seen.shape[1]) < seen.shape[1] - 1) - of_force
    H = _information(seen, [*columns, of_force, of_fat], of_force, level, emulator)
    covariance = np.linalg.inv(H)[: len(NAMES), : len(NAMES)]
    sd = {name: float(np.sqrt(covariance[k, k])) for k, name in enumerate(NAMES)}
    depth, down = np.exp(x[_DEPTH]), np.exp(x[_DOWN])
    share = np.zeros(len(NAMES))
    share[[NAMES.index("ln depth"), NAMES.index("ln down")]] = depth, down
    sd["ln t"] = float(np.sqrt(share @ covariance @ share) / (depth + down))
    return Limit(lump, sd)


def table_of(limits: Sequence[Limit]) -> pd.DataFrame:
    """Median of the least median errors: all lumps, hard and soft ones, those clearly over the noise."""
    hard = np.array([one.lump.strokes.case.E_inv23 <= HARD_BELOW for one in limits])
    small = np.array([one.lump.strokes.case.d_mm < 10 for one in limits])
    deep_mm = np.array([one.lump.strokes.case.depth_mm for one in limits])
    kinds = {
        "all": np.ones(len(limits), bool),
        "hard": hard,
        "soft": ~hard,
        "under 10 mm": small,
        "over 10 mm deep": deep_mm > 10,
        "soft, under 10 mm, over 8 mm deep": small & (deep_mm > 8) & ~hard,
    }
    rows = []
    for words, which in kinds.items():
        of = [one for one, wanted in zip(limits, which) if wanted]
        row: dict[str, object] = {"lumps of this kind": words, "lumps": len(of)}
        for name in ("ln d", "ln width", "ln depth", "ln t", "E^-2/3", "ln E_fat", "offset"):
            row[name] = float(np.median([_MEDIAN * one.sd[name] for one in of]))
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


def _signal(emulator: StrokeEmulator, x: Floats) -> Floats:
    """Pressures of all cells and the displacement, (frames, cells + 1): the press's, then the stroke's."""
    press = np.repeat(x[None], len(PRESS_PARTS), axis=0)
    press[:, _REACH] += np.log(PRESS_PARTS)
    images, depths = emulator.pressed(press)
    stroke, along = emulator.stroked(x[None], images[-1:], depths[-1:])
    places, stroke, along = both_sides(emulator.positions_mm, stroke[0], along[0])
    felt = CubicSpline(places, np.column_stack([stroke.reshape(len(places), -1), along]))
    at = np.linspace(places[0], places[-1], FRAMES)
    out: Floats = np.concatenate([np.column_stack([images.reshape(len(images), -1), depths]), felt(at)])
    return out


def _information(
    seen: Floats, columns: Sequence[Floats], of_force: Floats, n: Noise, emulator: StrokeEmulator
) -> Floats:
    """Of the parameters and, behind them, of what disturbs all cells alike; with what is known beforehand."""
    frames, cells = len(seen), seen.shape[1] - 1
    press = np.arange(frames) < len(PRESS_PARTS)
    span = emulator.positions_mm[-1] - emulator.positions_mm[0]
    slope = np.gradient(seen, 2 * span / (FRAMES - 1), axis=0)
    slope[press] = 0.0
    disturbances: list[tuple[Floats, float]] = []
    for k in range(frames):
        frame = (np.arange(frames) == k)[:, None]
        disturbances.append((frame * of_force, _FORCE_SD))
        if not press[k]:
            disturbances.append((frame * slope, n.position_mm))
    pressure = np.arange(cells + 1) < cells
    share = np.where(press, 0.0, np.linspace(-press.sum() / FRAMES, 1, frames))[:, None]
    zero = n.drift * FULL_SCALE_KPA
    disturbances += [(np.ones((frames, 1)) * pressure, zero), (share * pressure, 2 * zero)]
    disturbances += [(np.ones((frames, 1)) * ~pressure, n.displacement_zero_mm)]
    disturbances += [((2 * share - 1) * ~pressure, n.displacement_drift_mm)]
    if n.common_gain:
        disturbances.append((seen * pressure, n.common_gain))
    kept = [(signal, spread) for signal, spread in disturbances if spread > 0 and signal.any()]
    A = np.stack([*columns, *(signal for signal, _ in kept)], axis=2)
    often = np.where(press, np.sqrt(PRESS_FRAMES), 1.0)[:, None]
    A = A * often[:, :, None]
    H = np.einsum("fi,fj->ij", A[:, -1], A[:, -1]) / n.displacement_noise_mm**2
    white = n.white * FULL_SCALE_KPA
    spreads = np.array([n.gain, n.offset * FULL_SCALE_KPA])
    for cell in range(cells):
        own = A[:, cell]
        B = often * np.column_stack([seen[:, cell], np.ones(frames)]) * spreads / white
        across = B.T @ own
        H += (own.T @ own - across.T @ np.linalg.solve(np.eye(2) + B.T @ B, across)) / white**2
    known = np.array([*_PRIORS, *(spread for _, spread in kept)])
    out: Floats = H + np.diag(known**-2.0)
    return out
