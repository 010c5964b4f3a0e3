"""The firmware's pipeline in float64: what its integers are checked against. Units: mm, kPa, N/m.

The same definitions (docs/features.md) written once more with numpy and scipy: bins, traces, place, columns,
force map, least squares, features. Nothing here is trained on; models are trained on the integers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from firmware_py import bins, calib, feature_names, features, geometry, profile
from palpate.errors import UsageError
from palpate.features import press_features
from palpate.model_export.integers.force_map import ForceMap
from palpate.wire.cells import PITCH_MM, ROW_MM
from tests.firmware_py import pipeline_steps as steps
from tests.firmware_py import press_float
from tests.firmware_py.pipeline_steps import Gaussian, fit_like_firmware

__all__ = ["Gaussian", "Reference", "StrokeTooShort", "compute", "fit_like_firmware"]

Floats = NDArray[np.float64]

GRID_MM = np.arange(-28.0, 29.0)
REACH_MM = np.arange(-34.0, 35.0)
LEAST_CHANGE_MM = 0.0066
"""Beside the changes in their rms, so that those of noise alone stay small."""


class StrokeTooShort(UsageError):
    """The stroke does not reach far enough to both sides of the lump."""


@dataclass(frozen=True)
class Reference:
    """Everything the pipeline gives, in float64.

    Attributes
    ----------
    features : dict
        By the names of firmware_py.feature_names.NAMES.
    map_kPa : ndarray (57,)
        The tactile map about place_mm.
    fit : Gaussian
        centre from the map's middle.
    place_mm : float
        Where the lump was found, in the encoder's coordinate.
    columns : (int, int)
        First column used, and the one after the last.
    column_kPa : ndarray (columns,)
        How much of the bump each column sees.
    """

    features: dict[str, float]
    map_kPa: Floats
    fit: Gaussian
    place_mm: float
    columns: tuple[int, int]
    column_kPa: Floats


def compute(
    counts: ArrayLike,
    positions_mm: ArrayLike,
    displacements_mm: ArrayLike,
    calibration: calib.Calibration | None = None,
    force_map: ForceMap | None = None,
    width_mm: float = bins.WIDTH_UM / 1e3,
    press: tuple[ArrayLike, ArrayLike] | None = None,
) -> Reference:
    """The whole pipeline in float64.

    Parameters
    ----------
    counts : array_like (n, cells)
        Raw counts, whole or not.
    positions_mm, displacements_mm : array_like (n,)
    calibration, force_map, width_mm
        As for the firmware's pipeline.
    press : (counts (m, cells), displacements_mm (m,)), optional
        The frames between contact and the stroke's first.

    Raises
    ------
    StrokeTooShort
    """
    calibration = calibration or calib.Calibration()
    mean_counts, x, depth0 = steps.bin_frames(counts, positions_mm, displacements_mm, width_mm)
    p = steps.pressures(mean_counts, calibration)
    span = (0, geometry.COLUMNS)
    rows = p.mean(2)
    force = rows.sum(1)
    u = np.log(force.mean() / force)

    def moved(r: Floats) -> tuple[Floats, Floats]:
        return (r, depth0) if force_map is None else force_map.move(r, depth0, u)

    image, depth = moved(rows)
    points = int((x[-1] - x[0]) // 1) + 1
    margin = 24
    if points < 2 * margin + 1:
        raise StrokeTooShort(f"the stroke is {x[-1] - x[0]:.0f} mm long; it takes 48 mm or more")
    if points > 2 * margin + 9:
        margin = points // 2 - (points // 2 - margin) * 3 // 4
    wide = steps.method2(x, image, x[0] + np.arange(points))
    place = steps.find_place(wide, margin, points - 1 - margin)
    middle = x[0] + (points // 2 if place is None else place)

    def fitted(r: Floats) -> tuple[Floats, Gaussian]:
        y = steps.method2(x, r, middle + GRID_MM)
        if place is None:
            return y, steps.Gaussian(y.mean(), 0.0, 0.0, steps.STDEV_BOUNDS_MM[1], float(y.std()))
        return y, steps.fit_like_firmware(y)

    y, fit = fitted(image)
    answer = np.zeros(geometry.COLUMNS)
    if place is not None:
        level = force.mean() / force
        maps = np.zeros((len(GRID_MM), geometry.COLUMNS))
        for i, s in enumerate(ROW_MM):
            for c in range(geometry.COLUMNS):
                maps[:, c] += np.interp(middle + GRID_MM - s, x, p[:, i, c] * level) / geometry.ROWS
        bump = np.exp(-0.5 * ((GRID_MM - fit.centre) / fit.stdev) ** 2)
        bump -= bump.mean()
        answer = bump @ maps / (bump @ bump)
        span = steps.choose_columns(answer)
        if span != (0, geometry.COLUMNS):
            image, depth = moved(steps.evened_out(p[:, :, span[0] : span[1]].mean(2), x - middle, force))
            y, fit = fitted(image)
    pressed = np.empty((0, 5))
    if press:
        hang = steps.hanging(mean_counts, calibration.dead)
        pressed = press_float.curves(steps.mended(press[0], hang), press[1], calibration)
    seen_by = steps.rings(answer, calibration.count_mpa * 1e-6)
    found = _features(x, image, depth, middle + fit.centre, fit, float(force.mean()), pressed, seen_by)
    return Reference(found, y, fit, float(middle), (int(span[0]), int(span[1])), answer)


def _features(
    x: Floats,
    image: Floats,
    depth: Floats,
    centre: float,
    fit: Gaussian,
    force: float,
    pressed: Floats,
    across: Floats,
) -> dict[str, float]:
    w = steps.weights(x, centre + REACH_MM)
    r, d = w @ image, w @ depth
    away = np.abs(REACH_MM)
    # seen from either side, with the lump at negative places on the probe
    seen = np.where((REACH_MM < 0)[:, None], r[:, ::-1], r)

    def over(v: Floats, low: float, high: float) -> Floats:
        # the place over the lump counts for both sides
        m = (away >= low) & (away <= high)
        return np.average(v[m], axis=0, weights=np.where(away[m] == 0, 2.0, 1.0))

    middle = r[:, np.abs(ROW_MM) < PITCH_MM * profile.MIDDLE / 2].mean(1)
    d_far, p_far = over(d, 24, 33), over(middle, 24, 33)
    far, near, at28 = (over(0.5 * (r + r[:, ::-1]), *z) for z in ((24, 33), (0, 2), (26, 30)))

    def dip(low: float, high: float) -> float:
        return float(1 - over(d, low, high) / d_far)

    def trace(low: float, high: float) -> float:
        return float(over(middle, low, high) / p_far - 1)

    def tilt(low: float, high: float) -> float:
        s = over(seen, low, high)
        return float((s @ ROW_MM) / s.sum())

    def width(image: Floats) -> float:
        return float(0.5 * np.log(image @ ROW_MM**2 / image.sum()))

    base = max(fit.base, features.FLOOR / 2**11 * geometry.COUNT_MPA * 1e-6)
    out = {
        "ln_base": np.log(base),
        "ln_amp": np.log(max(fit.amp, base / 512)),
        "ln_stdev": np.log(fit.stdev),
        "inv_curvature": np.interp(8.0, ROW_MM, at28) / at28[geometry.HALF_ROWS],
        "ln_d28": np.log(over(d, 26, 30)),
        "ln_d0": np.log(over(d, 0, 2)),
        "ln_force": np.log(force * PITCH_MM),
        "asinh_amp": np.arcsinh(100 * fit.amp / base),
        "ln_d_far": np.log(d_far),
        "dip_6_10": dip(6, 10),
        "ln_centre_share": np.log(p_far / far.mean()),
        "ln_misfit": np.log(fit.rms / base + 1e-4),
        "asinh_rise": np.arcsinh(32 * trace(0, 2)),
        "trace_7_9": trace(7, 9),
        "trace_12_16": trace(12, 16),
        "dip_0_2": dip(0, 2),
        "dip_3_5": dip(3, 5),
        "dip_12_16": dip(12, 16),
        "dip_17_22": dip(17, 22),
        "trace_3_5": trace(3, 5),
        "trace_17_22": trace(17, 22),
        "tilt_3_5": tilt(3, 5),
        "tilt_6_9": tilt(6, 9),
        "tilt_10_14": tilt(10, 14),
        "ln_width_far": width(far),
        "ln_width_near": width(near) - width(far),
        "edge_far": far[: profile.OUTERMOST].mean() / far.mean(),
        "ln_peak": np.log(near.max() / near.mean()),
        "tilt_15_19": tilt(15, 19),
        "tilt_20_24": tilt(20, 24),
    }
    pulls = [tilt(*of) for of in ((3, 5), (6, 9), (10, 14), (15, 19), (20, 24), (25, 33))]
    lifts = [4 * np.clip(trace(*of), -4, 4) for of in ((0, 2), (3, 5), (7, 9), (12, 16), (17, 22))]
    changes = np.array(pulls + lifts)
    bump = np.sqrt((LEAST_CHANGE_MM**2 + changes @ changes) / len(changes))
    out["ln_bump"] = np.log(bump)
    out |= dict(zip(feature_names.NAMES[features.BUMP + 1 : features.ACROSS], changes / bump, strict=True))
    out |= dict(zip(feature_names.NAMES[features.ACROSS : features.ACROSS_END], across, strict=True))
    out["base_share"] = out["ln_base"] - out["ln_force"]
    at_parts = press_float.at_parts(pressed, out["ln_force"])
    out |= dict(zip(press_features.NAMES, at_parts, strict=True))
    return {name: float(out[name]) for name in feature_names.NAMES}
