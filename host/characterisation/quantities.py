"""What is measured of a sensor, each number with its 95 % interval; fractions as in `sim.probe.noise`.

Standard deviations come with chi-squared intervals where what is counted is independent (cells, recordings),
means with Student's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import least_squares

from firmware_py import geometry
from palpate.characterisation.campaign import STEP_S, Course, Floats, Measured
from palpate.sim.probe.noise import Noise
from palpate.sim.probe.sensors import SensorModel
from palpate.wire.cells import FULL_SCALE_KPA

LEVEL = 0.95
LAG_S = 0.3
"""Of the creep (`Noise.creep`)."""
CONTACT_KPA = 0.3
DEAD_RESPONSE = 0.2
"""Of the others' reading under a cuff: a cell that says less is dead."""


@dataclass(frozen=True)
class Quantity:
    """A number, its 95 % interval, and what it was taken from."""

    value: float
    low: float
    high: float
    of: str

    def changed(self, by: Callable[[float], float]) -> Quantity:
        """Number and ends as this function of them."""
        value, low, high = (float(by(v)) for v in (self.value, self.low, self.high))
        return Quantity(value, low, high, self.of)


def deviation(squares: float, freedom: float, of: str) -> Quantity:
    """The standard deviation whose sum of squares over `freedom` independent deviations is `squares`."""
    tails = (0.5 + LEVEL / 2, 0.5 - LEVEL / 2)
    low, high = (float(np.sqrt(squares / float(stats.chi2.ppf(p, freedom)))) for p in tails)
    return Quantity(float(np.sqrt(squares / freedom)), low, high, of)


def mean(values: Floats, of: str) -> Quantity:
    """A mean with Student's interval; from one value the interval is everything."""
    n = len(values)
    half = np.inf if n < 2 else stats.t.ppf(0.5 + LEVEL / 2, n - 1) * values.std(ddof=1) / np.sqrt(n)
    return Quantity(float(values.mean()), float(values.mean() - half), float(values.mean() + half), of)


def less(total: Quantity, part: float) -> Quantity:
    """A standard deviation without an independent part that is known: squares subtract."""
    return total.changed(lambda v: np.sqrt(max(v**2 - part**2, 0.0)))


@dataclass(frozen=True)
class Cells:
    """Which cells mean nothing: dead read a rail, or do not feel a cuff; stuck stand still elsewhere."""

    dead: NDArray[np.bool_]
    stuck: NDArray[np.bool_]

    @property
    def live(self) -> NDArray[np.bool_]:
        """The others."""
        return ~(self.dead | self.stuck)


def cells_of(found: list[Measured]) -> Cells:
    """Dead and stuck cells, over all recordings."""
    counts = np.concatenate([m.counts for m in found])
    # round imported strokes there is air that no cell has felt
    steady = [m.counts for m in found if m.kind != "plain"] or [counts]
    still = np.ptp(np.concatenate(steady), axis=0) == 0
    rail = still & np.isin(steady[0][0], (0, geometry.FULL_COUNT))
    deaf = np.zeros(still.shape, bool)
    pressed = [(m, m.course.at(m.time_s)) for m in found if m.course is not None]
    if pressed:
        rise = np.mean([np.tensordot(p - p.mean(), m.counts, (0, 0)) for m, p in pressed], axis=0)
        deaf = rise < DEAD_RESPONSE * np.median(rise)
    return Cells(rail | (deaf & ~still), still & ~rail)


def in_air(found: list[Measured], live: NDArray[np.bool_]) -> dict[str, Quantity]:
    """White noise, the cells' zeros, and the common zero's error and drift, from recordings in air."""
    air = [m for m in found if m.kind == "air"]
    if not air:
        return {}
    shares = [m.kPa[:, live] / FULL_SCALE_KPA for m in air]
    step = 1 / geometry.FULL_COUNT
    squares = sum(float((np.diff(s, axis=0) ** 2).sum()) / 2 for s in shares)
    count = sum(np.diff(s, axis=0).size for s in shares)
    # neighbouring differences share a reading: n differences are worth 2 n / 3
    white = less(deviation(squares * 2 / 3, count * 2 / 3, "air, cell by cell"), step / 12**0.5)
    zeros = np.mean([s.mean(axis=0) for s in shares], axis=0)
    own = zeros - zeros.mean()
    noise = np.hypot(white.value, step / 12**0.5) / np.sqrt(sum(map(len, shares)))
    offset = less(deviation(float((own**2).sum()), own.size - 1, "air, cell by cell"), noise)
    drifts = []
    for s in shares:
        common = s.mean(axis=1)
        slope, start = np.polyfit(np.linspace(0, 1, len(common)), common, 1)
        drifts += [start, slope / 2]
    drift = deviation(float(np.square(drifts).sum()), len(drifts), f"{len(air)} recordings in air")
    out = {"white": white, "offset": offset, "drift": drift}
    known = [m for m in air if np.isfinite(m.known_displacement_mm)]
    if known:
        ends = []
        for m in known:
            off = m.displacement_mm - m.known_displacement_mm
            slope, start = np.polyfit(np.linspace(-1, 1, len(off)), off, 1)
            ends.append((start, slope))
        of = f"{len(known)} recordings in air"
        zero, slopes = np.array(ends).T
        out["displacement_zero_mm"] = deviation(float((zero**2).sum()), len(zero), of)
        out["displacement_drift_mm"] = deviation(float((slopes**2).sum()), len(slopes), of)
    return out


def under_a_cuff(found: list[Measured], live: NDArray[np.bool_], white: float) -> dict[str, Quantity]:
    """Common gain's error, gain spread of cells and rows, hysteresis, creep, from recordings under a cuff."""
    cuff = [(m, m.course) for m in found if m.course is not None]
    if not cuff:
        return {}
    fits = [_sensor(m, course, live) for m, course in cuff]
    of = f"{len(cuff)} recordings under a cuff"
    gain, creep, hysteresis = np.array([fit.x[:3] for fit in fits]).T
    out = {
        "common_gain": mean(gain - 1, of),
        "creep": mean(creep, of),
        "hysteresis": mean(hysteresis, of),
    }
    gains, noise = [], []
    for (m, _), fit in zip(cuff, fits):
        A = np.column_stack([fit.read, np.ones(len(m.time_s)), m.time_s])
        inverse = np.linalg.inv(A.T @ A)
        gains.append((inverse @ A.T @ m.kPa.reshape(len(A), -1))[0].reshape(live.shape))
        noise.append(white * FULL_SCALE_KPA * np.sqrt(inverse[0, 0]))
    gain = np.mean(gains, axis=0)
    gain = gain / gain[live].mean()
    error = float(np.sqrt(np.mean(np.square(noise)) / len(noise)))
    kept = np.where(live, gain, np.nan)
    rows = np.nanmean(kept, axis=1)
    inside = (kept - rows[:, None])[live]
    spread = deviation(float((inside**2).sum()), inside.size - len(rows), of)
    of_rows = deviation(float(((rows - rows.mean()) ** 2).sum()), len(rows) - 1, of)
    out["gain"] = less(spread, error)
    out["row_gain"] = less(of_rows, spread.value / np.sqrt(live.sum() / len(rows)))
    return out


@dataclass(frozen=True)
class _Fit:
    """The mean cell under a cuff: gain, creep, hysteresis, zero and drift in kPa; and a cell of gain 1."""

    x: Floats
    read: Floats
    misfit: float


def _sensor(m: Measured, course: Course, live: NDArray[np.bool_]) -> _Fit:
    """The sensor model on one recording, its course begun where the model fits best."""
    seen = m.kPa[:, live].mean(axis=1)
    span = np.linspace(0, 1, len(seen))

    def fit(begins_s: float) -> _Fit:
        p = course.beginning(begins_s).at(m.time_s)

        def off(x: Floats) -> Floats:
            gain, creep, hysteresis, zero, drift = x
            return gain * _read(p, m.time_s, creep, hysteresis) + zero + drift * span - seen

        found = least_squares(off, [1.0, 0.01, 0.01, 0.0, 0.0])
        return _Fit(np.asarray(found.x, float), _read(p, m.time_s, *found.x[1:3]), float(found.cost))

    if np.ptp(course.kPa) == 0:
        return fit(course.begins_s)
    begins_s = [course.begins_s + step for step in np.linspace(-STEP_S, STEP_S, 9)]
    return min((fit(begin) for begin in begins_s), key=lambda one: one.misfit)


def _read(p: Floats, time_s: Floats, creep: float, hysteresis: float) -> Floats:
    """What a cell of gain 1 reads of the pressure p, kPa, as the sensor model has it (`SensorModel.felt`)."""
    lag = np.empty_like(p)
    lag[0] = p[0]
    decay = np.exp(-np.diff(time_s) / LAG_S)
    for k in range(1, len(p)):
        lag[k] = decay[k - 1] * lag[k - 1] + (1 - decay[k - 1]) * p[k]
    p = p + 2 * creep * (lag - p)
    most = np.maximum(np.maximum.accumulate(p), 1e-9)
    return np.asarray(p + 4 * hysteresis * p * (1 - p / most), float)


def over_plain_tissue(found: list[Measured], live: NDArray[np.bool_]) -> dict[str, Quantity]:
    """The hand's force, noise of position and displacement, the position's scale, from plain tissue."""
    strokes = [(m, s) for m in found if m.kind == "plain" for s in m.strokes]
    if not strokes:
        return {}
    of = f"{len(strokes)} strokes over plain tissue"
    force, position, depth, scale = [], [], [], []
    for m, own in strokes:
        felt = m.kPa[own][:, live].mean(axis=1)
        force.append(np.abs(felt / felt.mean() - 1).max())
        position.append(_rough(m.position_mm[own]))
        depth.append(_rough(m.displacement_mm[own]))
        if np.isfinite(m.travel_mm):
            rate = np.polyfit(m.time_s[own], m.position_mm[own], 1)[0]
            pressed = m.kPa[:, live].mean(axis=1) > CONTACT_KPA
            scale.append(rate * np.ptp(m.time_s[pressed]) / m.travel_mm - 1)
    hand = seen_of_a_hand()
    out = {
        "force": mean(np.array(force), of).changed(lambda v: max(v, 0.0) / hand),
        "position_mm": mean(np.array(position), of).changed(_root),
        "displacement_noise_mm": mean(np.array(depth), of).changed(_root),
    }
    if scale:
        out["position_scale"] = mean(np.array(scale), of)
    return out


def _rough(values: Floats) -> float:
    """Variance of white noise on a smooth series, from its third differences."""
    third = np.diff(values, 3)
    return float((third**2).mean() / 20)


def _root(v: float) -> float:
    return float(np.sqrt(max(v, 0.0)))


def seen_of_a_hand(hands: int = 400) -> float:
    """Which share of the sensor model's `force` shows as the largest departure from a stroke's own mean."""
    x = np.linspace(-40, 40, 50)
    shares = []
    for seed in range(hands):
        g = SensorModel(_AnyField(), Noise(force=0.1), seed).force_at(x)  # type: ignore[arg-type]
        shares.append(np.abs(g / g.mean() - 1).max() / 0.1)
    return float(np.mean(shares))


class _AnyField:
    """As much of a field as the hand's force needs."""

    pair, one_force, shape = True, False, (0,)
    ln_ratio, middle_N_per_m = 0.0, 100.0

    class low:
        F_N_per_m = 100.0
