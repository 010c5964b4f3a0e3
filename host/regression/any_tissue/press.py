"""What the press before a stroke tells: how deep, how wide, how peaked the image is at parts of the force.

The displacement alone tells force over stiffness to 7 %; how the image's shape changes with the force tells
it to a few, and every stroke begins with such a press. Units: mm, kPa, N/m.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_py import geometry
from palpate.features.map_features import Floats
from palpate.sim.probe.cells import FULL_SCALE_KPA, PEDESTAL_KPA, PITCH_MM, ROW_MM
from palpate.sim.probe.sensors import SensorModel, StrokeField

PARTS = (0.25, 0.5, 1.0)
"""Of the stroke's force: where the press is looked at."""

FRAMES = 24
"""Of a press of .6 s."""

_SENSOR_MM, _SENSOR_KPA = 0.05, 0.02
_MODEL_LN = 0.004
"""Errors by which a frame of the press counts: of the displacement, of an image's mean, and of a parabola."""

_LEAST_KPA = 1e-3
_MIDDLE = slice(geometry.HALF_ROWS - 2, geometry.HALF_ROWS + 2)


def press_frames(
    sensors: SensorModel, field: StrokeField, force_N_per_m: float, frames: int = FRAMES
) -> tuple[NDArray[np.uint16], NDArray[np.int64]]:
    """Counts (frames, cells) and displacements in um of a press up to a force, as the stroke's probe reads.

    Parameters
    ----------
    sensors : SensorModel
        The probe, and the tissue's stiffness where the stroke begins.
    field : StrokeField
        The press: strokes of one position at rising forces, the smallest about a fifth of the greatest.
    """
    start = -sensors.travel_mm / 2
    stiffness = float(sensors.stiffness_at(np.array([start]))[0])
    forces = force_N_per_m * np.linspace(0.2, 1.0, frames)
    image, depth = field.at(np.full(frames, field.reach_mm[0]), forces / stiffness)
    pressure = np.repeat(stiffness * image[:, :, None], geometry.COLUMNS, axis=2)
    counts, _, depth_um = sensors.felt(pressure, depth, np.full(frames, start), np.zeros(frames))
    return np.clip(np.rint(counts), 0, geometry.FULL_COUNT).astype(np.uint16), depth_um


def curves(counts: NDArray[np.uint16], depth_um: NDArray[np.int64], dead: NDArray[np.bool_]) -> Floats:
    """ln F, ln D, ln width and ln centre share of each frame, (frames, 4), from counts (frames, cells) and
    depth_um (frames); `dead` (cells) are left out."""
    kPa = counts / geometry.FULL_COUNT * FULL_SCALE_KPA - PEDESTAL_KPA
    cells = kPa.reshape(len(kPa), geometry.ROWS, geometry.COLUMNS)
    live = ~dead.reshape(geometry.ROWS, geometry.COLUMNS)
    rows = (cells * live).sum(2) / live.sum(1)
    rows = np.maximum((rows + rows[:, ::-1]) / 2, _LEAST_KPA)
    total = rows.sum(1)
    width = 0.5 * np.log(rows @ ROW_MM**2 / total)
    share = np.log(rows[:, _MIDDLE].mean(1) / rows.mean(1))
    return np.column_stack([np.log(PITCH_MM * total), np.log(np.maximum(depth_um, 20) / 1e3), width, share])


def at_parts(frames: Floats, ln_force: float) -> Floats:
    """ln D, ln width, ln centre share at `PARTS` of the force, nine numbers, by weighted parabolas in ln F.

    Parameters
    ----------
    frames : (n, 4)
        Of `curves`.
    ln_force : float
        Of the stroke.
    """
    x, D = frames[:, 0] - ln_force, np.exp(frames[:, 1])
    mean_kPa = np.exp(frames[:, 0]) / PITCH_MM / geometry.ROWS
    of_depth = (_SENSOR_MM / D) ** 2 + (_SENSOR_KPA / mean_kPa) ** 2 + _MODEL_LN**2
    of_shape = (_SENSOR_KPA / mean_kPa) ** 2 + _MODEL_LN**2
    A, wanted = np.vander(x, 3), np.vander(np.log(PARTS), 3)
    out = []
    for values, variance in zip(frames.T[1:], (of_depth, of_shape, of_shape)):
        weight = 1 / np.sqrt(variance)
        best = np.linalg.lstsq(A * weight[:, None], values * weight, rcond=None)[0]
        out.append(wanted @ best)
    return np.concatenate(out)
