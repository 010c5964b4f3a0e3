"""The steps of the pipeline in float64, each for itself (see pipeline_features). Units: mm, kPa."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from firmware_py import bins, calib, columns, gauss, geometry, search, stuck
from palpate.errors import UsageError
from palpate.features.gaussian import bounded_bump
from palpate.wire.cells import COLUMN_MM, ROW_MM, SHAPE

Floats = NDArray[np.float64]

_ROUNDING = 1e-6
"""Of a bin's mean, which the firmware rounds down to an eighth of a count."""

RINGS_MM = ((2, 5), (5, 9), (9, 15))
"""Over so far from the best column and up to so far; it stands for those within `_CORE_MM`."""
_CORE_MM, _LEAST_CORE_COUNTS = 2.0, 16

STDEV_BOUNDS_MM = (gauss.MIN_STDEV / 2**16, gauss.MAX_STDEV / 2**16)


@dataclass(frozen=True)
class Gaussian:
    """base + amp exp(-(x - centre)^2 / 2 stdev^2); pressures in the map's unit, lengths in mm."""

    base: float
    amp: float
    centre: float
    stdev: float
    rms: float


def bin_frames(
    counts: ArrayLike,
    positions_mm: ArrayLike,
    displacements_mm: ArrayLike,
    width_mm: float = bins.WIDTH_UM / 1e3,
) -> tuple[Floats, Floats, Floats]:
    """Means of the frames (n, cells) that fall into the same position bin, in rising position.

    Bins start where the first frame stood. Returns counts (m, cells), positions (m,), displacements (m,).
    """
    counts = np.asarray(counts, float)
    x = np.asarray(positions_mm, float)
    which = np.floor((x - x[0]) / width_mm + 1e-9).astype(int)
    _, index, n = np.unique(which, return_inverse=True, return_counts=True)
    if n.max() > 16:
        raise UsageError("more than 16 frames in a bin: the firmware would leave some out")

    def mean(v: Floats) -> Floats:
        out = np.zeros((len(n), *v.shape[1:]))
        np.add.at(out, index, v)
        return out / n.reshape(-1, *[1] * (v.ndim - 1))

    return mean(counts), mean(x), mean(np.asarray(displacements_mm, float))


def pressures(counts: Floats, calibration: calib.Calibration) -> Floats:
    """Calibrated pressures (m, rows, columns) in kPa; cells that hang or are dead have their neighbours'."""
    return filled(mended(counts, hanging(counts, calibration.dead)), calibration)


def filled(counts: ArrayLike, calibration: calib.Calibration) -> Floats:
    """The same where no cell hangs."""
    offset = np.array(calibration.offset) / 8
    gain = np.array(calibration.gain) / calib.UNIT_GAIN * calibration.count_mpa / 1e6
    p = (np.asarray(counts, float) - offset) * gain
    for i in range(0, calibration.fills, 3):
        cell, a, b = calibration.fill[i : i + 3]
        p[:, cell] = 0.5 * (p[:, a] + p[:, b])
    return p.reshape(-1, *SHAPE)


def hanging(counts: Floats, dead: bytearray) -> list[tuple[int, int, int]]:
    """Cells that hang in all of counts (m, cells), and the live neighbours of each (firmware_py.stuck)."""
    known = np.unpackbits(np.frombuffer(bytes(dead), np.uint8), bitorder="little").astype(bool)
    read = np.floor(8 * counts + _ROUNDING)
    still = (np.abs(read - read[0]) <= stuck.STILL).all(0) & ~known
    live = ~(known | still)
    out = []
    for i in np.flatnonzero(still):
        row = np.arange(geometry.COLUMNS) + i - i % geometry.COLUMNS
        beside = [*row[(row < i) & live[row]][-1:], *row[(row > i) & live[row]][:1]]
        if beside:
            mean = np.floor(4 * (counts[:, beside[0]] + counts[:, beside[-1]]) + _ROUNDING)
            away = np.abs(mean - read[0, i]).max() > stuck.AWAY
            if away or np.abs(mean - mean[0]).max() > stuck.MOVED:
                out.append((int(i), int(beside[0]), int(beside[-1])))
    return out


def mended(counts: ArrayLike, found: list[tuple[int, int, int]]) -> Floats:
    """Counts (m, cells) with these cells given their neighbours' mean."""
    out = np.array(counts, float)
    for i, a, b in found:
        out[:, i] = 0.5 * (out[:, a] + out[:, b])
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
    """Tactile map by Method 2 of images (n, rows) at the places `at`."""
    return np.mean([weights(x, at - s) @ rows[:, i] for i, s in enumerate(ROW_MM)], axis=0)


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


def fit_like_firmware(y: ArrayLike, widths_mm: tuple[float, ...] = (3.0, 6.0, 12.0)) -> Gaussian:
    """Least squares of a Gaussian on a base, the best from several widths; x = -n/2 .. n/2 mm.

    Bounds: amp at least 0, stdev 1.5 to 25 mm, the centre 14 mm or more inside the ends.
    """
    y = np.asarray(y, float)
    half = len(y) // 2
    x = np.arange(len(y)) - float(half)
    size = float(np.ptp(y)) or 1.0
    found = bounded_bump(
        x,
        y,
        [(float(np.median(y)), size / 2, 0.0, stdev) for stdev in widths_mm],
        (-np.inf, 0, 14 - half, STDEV_BOUNDS_MM[0]),
        (np.inf, np.inf, half - 14, STDEV_BOUNDS_MM[1]),
    )
    assert found is not None
    (base, amp, middle, stdev), rms = found
    return Gaussian(base, amp, middle, stdev, rms)


def choose_columns(answer: Floats) -> tuple[int, int]:
    """The columns that see the lump, from each column's share of the bump (firmware_py.columns)."""
    every = (0, len(answer))
    smooth = _smooth(answer)
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
    if b - a >= columns.NEARLY_ALL:
        return every
    far = np.r_[answer[: max(a - 2, 0)], answer[b + 2 :]]
    if len(far) >= 4 and far.mean() * 3 > peak:
        return every
    return a, b


def rings(answer: Floats, count_kPa: float) -> Floats:
    """What columns ever further from the best see of the bump, over what those within 2 mm of it do, (3,).

    The latter is 16 counts at least; count_kPa: one of them, in the unit of `answer`.
    """
    away_mm = np.round(np.abs(COLUMN_MM - COLUMN_MM[_smooth(answer).argmax()]), 6)
    core = max(answer[away_mm <= _CORE_MM].mean(), _LEAST_CORE_COUNTS * count_kPa)
    parts = [answer[(away_mm > low) & (away_mm <= high)] for low, high in RINGS_MM]
    out: Floats = np.clip([part.mean() / core if len(part) else 0.0 for part in parts], -4.0, 4.0)
    return out


def _smooth(answer: Floats) -> Floats:
    """Means of each column and its neighbours."""
    return np.array([answer[max(c - 1, 0) : c + 2].mean() for c in range(len(answer))])


def evened_out(rows: Floats, beside_mm: Floats, force: Floats) -> Floats:
    """Some columns' rows (n, rows) without what the hand's force makes of their share of it.

    Parameters
    ----------
    beside_mm : (n,)
        How far each image lies from the lump.
    force : (n,)
        Each image's sum over all columns, as a mean over them.
    """
    part = rows.sum(1)
    seen = (part > _LEAST_SUM) & (force > _LEAST_SUM)
    off = seen & (np.abs(beside_mm) >= _BESIDE_MM)
    if off.sum() < columns.FEWEST:
        return rows
    share = np.log(np.where(seen, part / force, 1.0))
    press = np.log(np.where(seen, force, 1.0) / force.mean())
    u = np.clip(press - press[off].mean(), -0.5, 0.5)[off]
    slope = u @ np.clip(share - share[off].mean(), -0.5, 0.5)[off] / (u @ u + _LEAN)
    out: Floats = rows * np.where(seen, np.exp(-np.clip(slope * press, -0.5, 0.5)), 1.0)[:, None]
    return out


_LEAST_SUM = 2048 / 32 * geometry.COUNT_MPA / 1e6
_BESIDE_MM, _LEAN = 16.0, 1e-3
"""As in `firmware_py.columns`."""
