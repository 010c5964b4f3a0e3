"""The firmware's pipeline in float64: what its integers are checked against. Units: mm, kPa, N/m.

The same definitions (docs/features.md) written once more with numpy and scipy: bins, traces, place, columns,
force map, least squares, features. Nothing here is trained on; models are trained on the integers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from firmware_py import bins, calib, features, search, stuck
from model_export.force_map import ForceMap

Floats = NDArray[np.float64]

SENSORS_MM = 1.5 * (np.arange(16) - 7.5)
GRID_MM = np.arange(-28.0, 29.0)
REACH_MM = np.arange(-34.0, 35.0)
STDEV_BOUNDS_MM = (1.5, 25.0)
COVER_MM = 24.0


class StrokeTooShort(ValueError):
    """The stroke does not reach far enough to both sides of the lump."""


@dataclass(frozen=True)
class Gaussian:
    """base + amp exp(-(x - centre)^2 / 2 stdev^2); pressures in the map's unit, lengths in mm."""

    base: float
    amp: float
    centre: float
    stdev: float
    rms: float


@dataclass(frozen=True)
class Reference:
    """Everything the pipeline gives, in float64.

    Attributes
    ----------
    features : dict
        By the names of firmware_py.features.NAMES.
    map_kPa : ndarray (57,)
        The tactile map about place_mm.
    fit : Gaussian
        centre from the map's middle.
    place_mm : float
        Where the lump was found, in the encoder's coordinate.
    columns : (int, int)
        First column used, and the one after the last.
    column_kPa : ndarray (26,)
        How much of the bump each column sees.
    """

    features: dict[str, float]
    map_kPa: Floats
    fit: Gaussian
    place_mm: float
    columns: tuple[int, int]
    column_kPa: Floats


def bin_frames(
    counts: ArrayLike, positions_mm: ArrayLike, displacements_mm: ArrayLike, width_mm: float = 1.5
) -> tuple[Floats, Floats, Floats]:
    """Means of the frames (n, 416) that fall into the same position bin, in rising position.

    Bins start where the first frame stood. Returns counts (m, 416), positions (m,), displacements (m,).
    """
    counts = np.asarray(counts, float)
    x = np.asarray(positions_mm, float)
    which = np.floor((x - x[0]) / width_mm + 1e-9).astype(int)
    _, index, n = np.unique(which, return_inverse=True, return_counts=True)
    if n.max() > 16:
        raise ValueError("more than 16 frames in a bin: the firmware would leave some out")

    def mean(v: Floats) -> Floats:
        out = np.zeros((len(n), *v.shape[1:]))
        np.add.at(out, index, v)
        return out / n.reshape(-1, *[1] * (v.ndim - 1))

    return mean(counts), mean(x), mean(np.asarray(displacements_mm, float))


def pressures(counts: Floats, calibration: calib.Calibration) -> Floats:
    """Calibrated pressures (m, 16, 26) in kPa; dead cells filled from their live neighbours."""
    offset = np.array(calibration.offset) / 8
    gain = np.array(calibration.gain) / calib.UNIT_GAIN * calibration.count_mpa / 1e6
    counts = _mended(counts, np.array(calibration.offset), calibration.dead)
    p = (counts - offset) * gain
    for i in range(0, calibration.fills, 3):
        cell, a, b = calibration.fill[i : i + 3]
        p[:, cell] = 0.5 * (p[:, a] + p[:, b])
    return p.reshape(-1, calib.ROWS, calib.COLS)


def _mended(counts: Floats, offset: NDArray[np.int64], dead: bytearray) -> Floats:
    """Counts with the cells that stand at a rail all along given their neighbours' (firmware_py.stuck)."""
    looked = counts[np.arange(5) * (len(counts) - 1) // 4]
    known = np.unpackbits(np.frombuffer(bytes(dead), np.uint8), bitorder="little").astype(bool)
    found = ((looked == 0).all(0) & (offset >= stuck.CLEAR)) | (looked == 4095).all(0)
    found &= ~known
    out = counts.copy()
    bad = known | found
    for i in np.flatnonzero(found):
        row = np.arange(i - i % calib.COLS, i - i % calib.COLS + calib.COLS)
        left, right = row[(row < i) & ~bad[row]], row[(row > i) & ~bad[row]]
        beside = [*left[-1:], *right[:1]]
        if beside:
            out[:, i] = 0.5 * (out[:, beside[0]] + out[:, beside[-1]])
    return out


def weights(x: Floats, at: ArrayLike) -> Floats:
    """Matrix (len(at), len(x)) of the cubic that carries values from the places x to the places `at`.

    Hermite's cubic with slopes from the chord over both neighbours, one-sided at the ends; constant beyond.
    """
    q = np.atleast_1d(np.asarray(at, float))
    n = len(x)
    k = np.clip(np.searchsorted(x, q, side="right") - 1, 0, n - 2)
    h = x[k + 1] - x[k]
    t = np.clip((q - x[k]) / h, 0, 1)
    up, left, right = 3 * t**2 - 2 * t**3, t - 2 * t**2 + t**3, t**3 - t**2
    w = np.zeros((len(q), n))
    row = np.arange(len(q))
    w[row, k] += 1 - up
    w[row, k + 1] += up
    for slope, i in ((left, k), (right, k + 1)):
        before, after = np.maximum(i - 1, 0), np.minimum(i + 1, n - 1)
        share = slope * h / (x[after] - x[before])
        w[row, after] += share
        w[row, before] -= share
    return w


def method2(x: Floats, rows: Floats, at: Floats) -> Floats:
    """Tactile map by Method 2 of images `rows` (n, 16) at the places `at`."""
    return np.mean([weights(x, at - s) @ rows[:, i] for i, s in enumerate(SENSORS_MM)], axis=0)


def find_place(y: Floats, low: int, high: int) -> int | None:
    """Index of the best matched Gaussian bump with its middle in low..high; None where nothing rises."""
    yc = y - y.mean()
    best, place = -np.inf, None
    for width in np.array(search.WIDTHS_UM) / 1e3:
        for c in range(low, high + 1):
            d = np.abs(np.arange(len(y)) - c)
            g = np.where(d / width < 3.54, np.exp(-((d / width) ** 2) / 2), 0)
            norm = (g * g).sum() - g.sum() ** 2 / len(y)
            num = (g * yc).sum()
            if num > 0 and norm > 0 and num / np.sqrt(norm) > best:
                best, place = num / np.sqrt(norm), c
    return place


def fit_gaussian(
    y: ArrayLike, centre: float = 0.0, widths_mm: tuple[float, ...] = (3.0, 6.0, 12.0)
) -> Gaussian:
    """Least squares of a Gaussian on a base, the best from several widths; x = -n/2 .. n/2 mm.

    Bounds: amp at least 0, stdev 1.5 to 25 mm, the centre 14 mm or more inside the ends.
    """
    y = np.asarray(y, float)
    half = len(y) // 2
    x = np.arange(len(y)) - float(half)
    size = float(np.ptp(y)) or 1.0

    def residual(p: Floats) -> Floats:
        return (p[0] + p[1] * np.exp(-0.5 * ((x - p[2]) / p[3]) ** 2) - y) / size

    def slope(p: Floats) -> Floats:
        z = (x - p[2]) / p[3]
        g = np.exp(-0.5 * z * z)
        b = p[1] / p[3] * g * z
        return np.column_stack([np.ones_like(x), g, b, b * z]) / size

    best = None
    for stdev in widths_mm:
        start = [float(np.median(y)), size / 2, np.clip(centre, 14.01 - half, half - 14.01), stdev]
        lower = [-np.inf, 0, 14 - half, STDEV_BOUNDS_MM[0]]
        upper = [np.inf, np.inf, half - 14, STDEV_BOUNDS_MM[1]]
        r = least_squares(
            residual,
            start,
            slope,
            bounds=(lower, upper),
            x_scale=[size, size, 3, 3],
            xtol=1e-11,
            ftol=1e-12,
            gtol=1e-11,
        )
        if best is None or r.cost < best.cost - 1e-12:
            best = r
    assert best is not None
    base, amp, middle, stdev = best.x
    return Gaussian(base, amp, middle, stdev, size * float(np.sqrt(2 * best.cost / len(y))))


def choose_columns(answer: Floats) -> tuple[int, int]:
    """The columns that see the lump, from each column's share of the bump (firmware_py.columns)."""
    every = (0, len(answer))
    smooth = np.array([answer[max(c - 1, 0) : c + 2].mean() for c in range(len(answer))])
    best = int(smooth.argmax())
    peak = smooth[best]
    second = np.abs(np.diff(answer, 2))
    noise = np.sort(second)[len(second) // 2 - 1] * 39 / 64
    if peak * 12 < 6 * 7 * noise:
        return every
    a, b = best, best + 1
    while a > 0 and smooth[a - 1] >= peak / 2:
        a -= 1
    while b < len(answer) and smooth[b] >= peak / 2:
        b += 1
    if b - a >= 22:
        return every
    far = np.r_[answer[: max(a - 2, 0)], answer[b + 2 :]]
    if len(far) >= 4 and far.mean() * 3 > peak:
        return every
    return a, b


def compute(
    counts: ArrayLike,
    positions_mm: ArrayLike,
    displacements_mm: ArrayLike,
    calibration: calib.Calibration | None = None,
    force_map: ForceMap | None = None,
    fixed_columns: tuple[int, int] | None = None,
    width_mm: float = bins.WIDTH_UM / 1e3,
) -> Reference:
    """The whole pipeline in float64.

    Parameters
    ----------
    counts : array_like (n, 416)
        Raw counts, whole or not.
    positions_mm, displacements_mm : array_like (n,)
    calibration, force_map, fixed_columns, width_mm
        As for the firmware's pipeline.

    Raises
    ------
    StrokeTooShort
    """
    calibration = calibration or calib.Calibration()
    mean_counts, x, depth0 = bin_frames(counts, positions_mm, displacements_mm, width_mm)
    p = pressures(mean_counts, calibration)
    span = fixed_columns or (0, calib.COLS)
    rows = p[:, :, span[0] : span[1]].mean(2)
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
    wide = method2(x, image, x[0] + np.arange(points))
    place = find_place(wide, margin, points - 1 - margin)
    middle = x[0] + (points // 2 if place is None else place)

    def fitted(r: Floats) -> tuple[Floats, Gaussian]:
        y = method2(x, r, middle + GRID_MM)
        if place is None:
            return y, Gaussian(y.mean(), 0.0, 0.0, STDEV_BOUNDS_MM[1], float(y.std()))
        return y, fit_gaussian(y)

    y, fit = fitted(image)
    answer = np.zeros(calib.COLS)
    if not fixed_columns and place is not None:
        level = force.mean() / force
        maps = np.zeros((len(GRID_MM), calib.COLS))
        for i, s in enumerate(SENSORS_MM):
            for c in range(calib.COLS):
                maps[:, c] += np.interp(middle + GRID_MM - s, x, p[:, i, c] * level) / 16
        bump = np.exp(-0.5 * ((GRID_MM - fit.centre) / fit.stdev) ** 2)
        bump -= bump.mean()
        answer = bump @ maps / (bump @ bump)
        span = choose_columns(answer)
        if span != (0, calib.COLS):
            image, depth = moved(p[:, :, span[0] : span[1]].mean(2))
            y, fit = fitted(image)
    found = _features(x, image, depth, middle + fit.centre, fit, float(force.mean()))
    return Reference(found, y, fit, float(middle), (int(span[0]), int(span[1])), answer)


def _features(
    x: Floats, image: Floats, depth: Floats, centre: float, fit: Gaussian, force: float
) -> dict[str, float]:
    w = weights(x, centre + REACH_MM)
    r, d = w @ image, w @ depth
    away = np.abs(REACH_MM)
    # seen from either side, with the lump at negative places on the probe
    seen = np.where((REACH_MM < 0)[:, None], r[:, ::-1], r)

    def over(v: Floats, low: float, high: float) -> Floats:
        # the place over the lump counts for both sides
        m = (away >= low) & (away <= high)
        return np.average(v[m], axis=0, weights=np.where(away[m] == 0, 2.0, 1.0))

    middle = r[:, 6:10].mean(1)
    d_far, p_far = over(d, 24, 33), over(middle, 24, 33)
    far, near, at28 = (over(0.5 * (r + r[:, ::-1]), *z) for z in ((24, 33), (0, 2), (26, 30)))
    half = np.abs(SENSORS_MM)

    def dip(low: float, high: float) -> float:
        return float(1 - over(d, low, high) / d_far)

    def trace(low: float, high: float) -> float:
        return float(over(middle, low, high) / p_far - 1)

    def tilt(low: float, high: float) -> float:
        s = over(seen, low, high)
        return float((s @ SENSORS_MM) / s.sum())

    def width(image: Floats) -> float:
        return float(0.5 * np.log(image @ half**2 / image.sum()))

    base = max(fit.base, features.FLOOR / 2**11 * 6105e-6)
    out = {
        "ln_base": np.log(base),
        "ln_amp": np.log(max(fit.amp, base / 512)),
        "ln_stdev": np.log(fit.stdev),
        "inv_curvature": (5 * at28[2] + at28[3]) / 6 / at28[7],
        "ln_d28": np.log(over(d, 26, 30)),
        "ln_d0": np.log(over(d, 0, 2)),
        "ln_force": np.log(force * 1.5),
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
        "edge_far": far[:2].mean() / far.mean(),
        "ln_peak": np.log(near.max() / near.mean()),
        "tilt_15_19": tilt(15, 19),
        "tilt_20_24": tilt(20, 24),
    }
    return {name: float(out[name]) for name in features.NAMES}
