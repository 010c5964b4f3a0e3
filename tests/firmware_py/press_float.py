"""The press before a stroke in float64: what the probe's integers (firmware_py.press) are checked against.

Units: mm, kPa, N/m.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from firmware_py import calib, geometry, press, profile
from palpate.features.press_features import NAMES
from palpate.model_export.vocabulary import ABSENT
from palpate.wire.cells import PITCH_MM, ROW_MM
from tests.firmware_py.pipeline_steps import filled

Floats = NDArray[np.float64]

PARTS = (0.25, 0.5, 1.0)
"""Of the stroke's force: where the press is looked at."""

_SENSOR_MM, _SENSOR_KPA = 0.05, 0.02
_MODEL_LN = 0.004
"""Errors by which a frame of the press counts: of the displacement, of an image's mean, and of a parabola."""

_COUNTING = (-2.0, 0.4)
_WANTED = (-1.05, -0.2)
"""ln(force / stroke's): of the frames that count; the least and the greatest reach this far or further."""

_LEAST_MM = 0.02
_BENT = 5e-4
_MOST_SHARE = 2.0
_OUTER_MM = 4.5
"""At either side of the face: how far the outer columns reach in."""
_MIDDLE = np.abs(ROW_MM) < PITCH_MM * profile.MIDDLE / 2


def curves(
    counts: ArrayLike, displacements_mm: ArrayLike, calibration: calib.Calibration | None = None
) -> Floats:
    """ln F, ln D, ln width, ln centre share and outer columns' share of each frame, (n, 5).

    Parameters
    ----------
    counts : (n, cells)
    displacements_mm : (n,)
    calibration : calib.Calibration, optional
        By default nominal. Its dead cells are filled as in a stroke.
    """
    calibration = calibration or calib.Calibration()
    image = filled(counts, calibration)
    rows, outer = image.mean(2), max(1, int(_OUTER_MM / PITCH_MM))
    sides = image[:, _MIDDLE][:, :, np.r_[:outer, geometry.COLUMNS - outer : geometry.COLUMNS]].mean((1, 2))
    least = press.LEAST / 2 / 32 * calibration.count_mpa / 1e6
    rows = np.maximum((rows + rows[:, ::-1]) / 2, least)
    total = rows.sum(1)
    width = 0.5 * np.log(rows @ ROW_MM**2 / total)
    share = np.log(rows[:, _MIDDLE].mean(1) / rows.mean(1))
    depth = np.maximum(np.asarray(displacements_mm, float), _LEAST_MM)
    of_sides = np.clip(sides * geometry.ROWS / total, -_MOST_SHARE, _MOST_SHARE)
    return np.column_stack([np.log(PITCH_MM * total), np.log(depth), width, share, of_sides])


def at_parts(frames: Floats, ln_force: float) -> Floats:
    """What `curves` gives at `PARTS` of the force, by `NAMES`, by weighted parabolas in ln F.

    All are `ABSENT` where the press is too short, or its forces do not reach far enough.

    Parameters
    ----------
    frames : (n, 5)
        Of `curves`.
    ln_force : float
        Of the stroke, N/m.
    """
    frames = np.asarray(frames, float).reshape(-1, 5)
    x = frames[:, 0] - ln_force
    counting = (x >= _COUNTING[0]) & (x <= _COUNTING[1])
    x, frames = x[counting], frames[counting]
    if len(x) < press.FEWEST or x.min() > _WANTED[0] or x.max() < _WANTED[1]:
        return np.full(len(NAMES), ABSENT)
    mean_kPa = np.exp(frames[:, 0]) / PITCH_MM / geometry.ROWS
    of_shape = (_SENSOR_KPA / mean_kPa) ** 2 + _MODEL_LN**2
    of_depth = of_shape + np.minimum((_SENSOR_MM / np.exp(frames[:, 1])) ** 2, 4.0)
    A, wanted = np.vander(x, 3), np.vander(np.log(PARTS), 3)
    out = []
    for values, variance in zip(frames.T[1:], (of_depth, of_shape, of_shape, of_shape)):
        if not _bent(x, 1 / variance):
            return np.full(len(NAMES), ABSENT)
        weight = 1 / np.sqrt(variance)
        best = np.linalg.lstsq(A * weight[:, None], values * weight, rcond=None)[0]
        out.append(wanted @ best)
    return np.concatenate(out)


def _bent(x: Floats, weight: Floats) -> bool:
    """Whether these places (n,) with these weights tell a parabola from a line."""
    w = weight / weight.sum()
    p = x - w @ x
    b = w @ p**2
    if b < 16 * _BENT:
        return False
    bent = p**2 - (w @ p**3) / b * p - b
    return bool(w @ bent**2 >= _BENT)
