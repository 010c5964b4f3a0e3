"""What the probe's sensors read of a finite-element stroke. Units: mm, kPa, N/m; frames in 12-bit counts.

A hand does not press evenly, a sensor is not its data sheet, and an encoder starts anywhere. `Noise` names
each of these; `SensorModel` is one physical probe in one hand; `stroke_frames` is one stroke of it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from firmware_py import calib
from sim.tissue import Stroke

Floats = NDArray[np.float64]

FULL_SCALE_KPA = 25.0
PEDESTAL_KPA = 0.5
MAX_COUNT = 4095
FORCE_RATIO = 1.4
ROWS, COLS = calib.ROWS, calib.COLS
_COLUMN_MM = 1.5 * (np.arange(COLS) - (COLS - 1) / 2)


@dataclass(frozen=True)
class Noise:
    """Everything between the skin and the count; sensor errors are fractions of full scale or of the reading.

    Attributes
    ----------
    white, offset, drift : float
        Of full scale, standard deviations: of each reading, of each cell's zero since calibration, of the
        common zero (at the start, and twice that more by the end).
    gain, row_gain : float
        Of the reading: spread of the cells, and of whole rows.
    dead, dead_unknown : float
        Share of dead cells; share of these that the calibration does not know.
    displacement_noise_mm, displacement_zero_mm, displacement_drift_mm : float
        White noise, zero error, and linear drift (half its range) of the displacement.
    position_mm, position_scale : float
        White noise of the encoder's reading, and its scale error.
    force : float
        Greatest departure of the hand's force from its mean, as a fraction, wandering slowly.
    creep : float
        Twice the part of each reading that lags by .3 s at 60 mm/s.
    start_mm : float
        The lump lies up to so far from the middle of the stroke.
    quantise : bool
        Whether an ADC is there at all; False keeps the frames' counts in float64 for reference.
    """

    white: float = 0.0
    offset: float = 0.0
    drift: float = 0.0
    gain: float = 0.0
    row_gain: float = 0.0
    dead: float = 0.0
    dead_unknown: float = 0.0
    displacement_noise_mm: float = 0.0
    displacement_zero_mm: float = 0.0
    displacement_drift_mm: float = 0.0
    position_mm: float = 0.0
    position_scale: float = 0.0
    force: float = 0.0
    creep: float = 0.0
    start_mm: float = 0.0
    quantise: bool = True

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name != "quantise" and not 0 <= value < (1 if f.name in ("dead", "force") else 1e3):
                raise ValueError(f"noise '{f.name}' is {value}: it must be 0 or more (dead, force: below 1)")

    def without(self, *names: str) -> Noise:
        """The same with the named disturbances at 0."""
        return self.with_(**dict.fromkeys(names, 0.0))

    def with_(self, **values: Any) -> Noise:
        """The same with some disturbances set."""
        return replace(self, **values)


LEVELS: dict[str, Noise] = {
    "none": Noise(),
    "good": Noise(
        white=0.001, offset=0.001, drift=0.0005, gain=0.01, dead=0.01,
        displacement_noise_mm=0.010, displacement_zero_mm=0.02, displacement_drift_mm=0.02,
        position_mm=0.1, position_scale=0.001, force=0.05, creep=0.005, start_mm=5.0,
    ),
    "typical": Noise(
        white=0.0025, offset=0.002, drift=0.001, gain=0.02, dead=0.01,
        displacement_noise_mm=0.025, displacement_zero_mm=0.05, displacement_drift_mm=0.05,
        position_mm=0.25, position_scale=0.003, force=0.10, creep=0.01, start_mm=5.0,
    ),
    "poor": Noise(
        white=0.005, offset=0.004, drift=0.002, gain=0.03, dead=0.01,
        displacement_noise_mm=0.050, displacement_zero_mm=0.1, displacement_drift_mm=0.1,
        position_mm=0.5, position_scale=0.005, force=0.20, creep=0.02, start_mm=5.0,
    ),
}  # fmt: skip


class StrokeField:
    """Images and displacement of one case at any position and, with a second stroke, near any force.

    Parameters
    ----------
    low : Stroke
        From at least 28 mm before the lump to over it; the other side is its mirror image.
    high : Stroke, optional
        The same case at a greater force (FORCE_RATIO times). Between and around the two, pressures are
        interpolated in the logarithm where both are over .3 kPa, else linearly in the force.
    """

    def __init__(self, low: Stroke, high: Stroke | None = None) -> None:
        pair = [low] if high is None else [low, high]
        positions = low.positions_mm
        for s in pair:
            if len(s.positions_mm) != len(positions) or not np.allclose(s.positions_mm, positions):
                raise ValueError(f"{s.code} was simulated at other positions than {low.code}")
        if high is not None and not high.F_N_per_m > low.F_N_per_m:
            raise ValueError(f"{high.code} must be pressed harder than {low.code}")
        self.low = low
        self.pair = high is not None
        self.ln_ratio = float(np.log(high.F_N_per_m / low.F_N_per_m)) if high is not None else 1.0
        one_sided = positions[-1] < 1e-9
        tables = []
        for s in pair:
            table = np.column_stack([s.images_kPa, s.displacement_mm])
            if len(positions) == 1:
                table = np.repeat(table, 3, axis=0)
            elif one_sided:
                back = np.column_stack([s.images_kPa[-2::-1, ::-1], s.displacement_mm[-2::-1]])
                table = np.concatenate([table, back])
            tables.append(table)
        if len(positions) == 1:
            x = np.array([-40.0, 0.0, 40.0])
        else:
            x = np.concatenate([positions, -positions[-2::-1]]) if one_sided else positions
        self.reach_mm = (float(x[0]), float(x[-1]))
        self._splines = [CubicSpline(x, t, axis=0) for t in tables]

    def at(self, position_mm: Floats, force_N_per_m: Floats | None = None) -> tuple[Floats, Floats]:
        """Images (n, 16) in kPa and displacement (n,) in mm at the places (n,) and forces (n,).

        Outside the simulated places the last image stays.
        """
        x = np.clip(np.asarray(position_mm, float), *self.reach_mm)
        lo = np.maximum(self._splines[0](x), 0)
        if force_N_per_m is None:
            return lo[:, :16], lo[:, 16]
        u = np.log(np.asarray(force_N_per_m, float) / self.low.F_N_per_m)
        if not self.pair:
            if np.any(np.abs(u) > 1e-9):
                raise ValueError(f"{self.low.code} was simulated at one force only: the hand cannot vary it")
            return lo[:, :16], lo[:, 16]
        hi = np.maximum(self._splines[1](x), 0)
        share = (np.expm1(u) / np.expm1(self.ln_ratio))[:, None]
        linear = lo + share * (hi - lo)
        u = (u / self.ln_ratio)[:, None]
        loaded = (lo > 0.3) & (hi > 0.3)
        safe_lo, safe_hi = np.where(loaded, lo, 1.0), np.where(loaded, hi, 1.0)
        out = np.where(loaded, safe_lo ** (1 - u) * safe_hi**u, np.maximum(linear, 0))
        # displacement is always taken in the logarithm
        out[:, 16] = lo[:, 16] ** (1 - u[:, 0]) * hi[:, 16] ** u[:, 0]
        return out[:, :16], out[:, 16]


@dataclass(frozen=True)
class Truth:
    """What the estimate is compared with: the case's inputs at the force that the hand really kept."""

    F_N_per_m: float
    t_mm: float
    d_mm: float
    h: float
    E_inv23: float
    lump: bool
    centre_mm: float

    def outputs(self) -> dict[str, float]:
        """The five outputs of the inverse model, in its order."""
        return {k: getattr(self, k) for k in ("F_N_per_m", "t_mm", "d_mm", "h", "E_inv23")}


@dataclass(frozen=True)
class FrameStream:
    """A stroke as the wire carries it.

    Attributes
    ----------
    packed : list of bytes
        Each frame's 624 bytes.
    counts : ndarray (n, 416)
        The same counts (float64 where Noise.quantise is False, then `packed` holds them rounded).
    positions_um, displacements_um, times_us : ndarray (n,), int
    truth : Truth
    """

    packed: list[bytes]
    counts: NDArray[Any]
    positions_um: NDArray[np.int64]
    displacements_um: NDArray[np.int64]
    times_us: NDArray[np.int64]
    truth: Truth

    def __len__(self) -> int:
        return len(self.packed)


def pack(counts: NDArray[Any]) -> bytes:
    """Pack 416 counts of 12 bits, two in three bytes."""
    v = np.asarray(counts).astype(np.uint16).reshape(-1, 2)
    out = np.empty((len(v), 3), np.uint8)
    out[:, 0] = v[:, 0] & 255
    out[:, 1] = v[:, 0] >> 8 | (v[:, 1] & 15) << 4
    out[:, 2] = v[:, 1] >> 4
    return out.tobytes()


def unpack(packed: bytes) -> NDArray[np.uint16]:
    """The 416 counts of a packed frame."""
    b = np.frombuffer(packed, np.uint8).reshape(-1, 3).astype(np.uint16)
    return np.column_stack([b[:, 0] | (b[:, 1] & 15) << 8, b[:, 1] >> 4 | b[:, 2] << 4]).ravel()


class SensorModel:
    """One probe (its gains, zeros and dead cells) in one hand (its wandering force) over one lump.

    Parameters
    ----------
    field : StrokeField
    noise : Noise
    seed : int
        Same seed, same probe, same hand, same stroke.
    across_mm : float, optional
        For a ball-like lump: standard deviation across the stroke of the extra pressure over that far from
        the lump (FACTS: about 3.9). None leaves all columns alike, as plane strain has it.
    across_centre_mm : float
        Where such a lump lies across the probe.
    mean_force_N_per_m : float, optional
        The hand's mean force; by default the geometric mean of the field's pair.
    travel_mm : float
        How far the stroke goes.
    """

    def __init__(
        self,
        field: StrokeField,
        noise: Noise,
        seed: int = 0,
        *,
        across_mm: float | None = None,
        across_centre_mm: float = 0.0,
        mean_force_N_per_m: float | None = None,
        travel_mm: float = 80.0,
    ) -> None:
        if not field.pair and noise.force:
            raise ValueError(f"{field.low.code} was simulated at one force only: the hand cannot vary it")
        self.field, self.noise, self.travel_mm = field, noise, travel_mm
        rng = self._rng = np.random.default_rng(seed)
        F = field.low.F_N_per_m * (np.exp(field.ln_ratio / 2) if field.pair else 1.0)
        self.mean_force_N_per_m = F if mean_force_N_per_m is None else mean_force_N_per_m
        n = noise
        self.gain = 1 + n.gain * rng.standard_normal((ROWS, COLS))
        self.gain *= 1 + n.row_gain * rng.standard_normal((ROWS, 1))
        self.offset_kPa = n.offset * FULL_SCALE_KPA * rng.standard_normal((ROWS, COLS))
        self.zero_kPa, self.zero_drift_kPa = n.drift * FULL_SCALE_KPA * rng.standard_normal(2) * (1, 2)
        self.dead = rng.random((ROWS, COLS)) < n.dead
        self.known_dead = self.dead & (rng.random((ROWS, COLS)) >= n.dead_unknown)
        self.displacement_zero_mm = n.displacement_zero_mm * rng.standard_normal()
        self.displacement_drift_mm = n.displacement_drift_mm * rng.standard_normal()
        self.position_scale = 1 + n.position_scale * rng.standard_normal()
        self.start_mm = rng.uniform(-n.start_mm, n.start_mm)
        wave = np.exp(rng.uniform(np.log(30), np.log(160), 3))
        phase = rng.uniform(0, 2 * np.pi, 3)
        size = rng.uniform(0.3, 1, 3)
        self._wave = (wave, phase, size)
        grid = np.linspace(-travel_mm / 2, travel_mm / 2, 201)
        self._wave_peak = float(np.abs(self._sines(grid)).max())
        if across_mm is None:
            self._across = None
        else:
            self._across = np.exp(-((_COLUMN_MM - across_centre_mm) ** 2) / (2 * across_mm**2))
        self._lag: Floats | None = None
        self._lag_at: float | None = None

    def _sines(self, x: Floats) -> Floats:
        wave, phase, size = self._wave
        return (size * np.sin(2 * np.pi * np.asarray(x)[..., None] / wave + phase)).sum(-1)

    def calibration(self, known_dead: bool = True) -> calib.Calibration:
        """The calibration that this probe left the bench with: nominal but for its known dead cells."""
        c = calib.Calibration(round(FULL_SCALE_KPA * 1e6 / MAX_COUNT))
        if known_dead:
            c.set_dead([int(i) for i in np.flatnonzero(self.known_dead)])
        return c

    def force_at(self, stroke_mm: Floats) -> Floats:
        """The hand's force in N/m at places along the stroke (0: its middle)."""
        g = self._sines(np.asarray(stroke_mm, float)) / self._wave_peak
        return self.mean_force_N_per_m * (1 + self.noise.force * g)

    def pressures_at(self, stroke_mm: Floats) -> tuple[Floats, Floats]:
        """True pressures (n, 16, 26) in kPa and displacement (n,) in mm at places along the stroke."""
        x = np.atleast_1d(np.asarray(stroke_mm, float))
        force = self.force_at(x) if self.field.pair else None
        image, depth = self.field.at(x + self.start_mm, force)
        if self._across is None:
            return np.repeat(image[:, :, None], COLS, axis=2), depth
        far, far_depth = self.field.at(np.full_like(x, self.field.reach_mm[0]), force)
        p = far[:, :, None] + (image - far)[:, :, None] * self._across
        # the long face rides over a ball: the probe hardly rises
        return np.maximum(p, 0), far_depth + 0.25 * (depth - far_depth)

    def counts_at(self, stroke_mm: float) -> tuple[NDArray[np.uint16], int, int]:
        """One live reading at a place along the stroke: counts (416,), position and displacement in um."""
        counts, x, d = self._read(np.array([stroke_mm]), np.array([stroke_mm / self.travel_mm + 0.5]))
        return np.clip(np.rint(counts[0]), 0, MAX_COUNT).astype(np.uint16), int(x[0]), int(d[0])

    def _read(self, x: Floats, share: Floats) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
        n, rng = self.noise, self._rng
        p, depth = self.pressures_at(x)
        if n.creep:
            p = p + n.creep * 2 * (self._lagged(p, x) - p)
        p = p * self.gain + self.offset_kPa
        p += (self.zero_kPa + self.zero_drift_kPa * share)[:, None, None]
        if n.white:
            p += n.white * FULL_SCALE_KPA * rng.standard_normal(p.shape)
        counts = (p + PEDESTAL_KPA) / FULL_SCALE_KPA * MAX_COUNT
        counts[:, self.dead] = 0
        depth = depth + self.displacement_zero_mm + self.displacement_drift_mm * (2 * share - 1)
        depth = depth + n.displacement_noise_mm * rng.standard_normal(len(x))
        place = x * self.position_scale + n.position_mm * rng.standard_normal(len(x))
        return (
            counts.reshape(len(x), -1),
            np.rint(place * 1e3).astype(np.int64),
            np.rint(depth * 1e3).astype(np.int64),
        )

    def _lagged(self, p: Floats, x: Floats) -> Floats:
        """First-order lag of .3 s at 60 mm/s, that is 18 mm of travel."""
        out = np.empty_like(p)
        for k in range(len(x)):
            if self._lag is None or self._lag_at is None:
                self._lag = p[k]
            else:
                a = np.exp(-abs(x[k] - self._lag_at) / 18)
                self._lag = a * self._lag + (1 - a) * p[k]
            self._lag_at = float(x[k])
            out[k] = self._lag
        return out

    def truth(self, stroke_mm: Floats) -> Truth:
        """The inputs that a stroke through these places is to be inverted to."""
        c = self.field.low.case
        F = float(np.mean(self.force_at(stroke_mm))) if self.field.pair else self.field.low.F_N_per_m
        return Truth(F, c.t_mm, c.d_mm, c.h, c.E_ratio ** (-2 / 3), c.has_lump, -self.start_mm)

    def stroke(self, n_frames: int = 50, frames_per_s: float = 37.5, origin_um: int = 0) -> FrameStream:
        """A whole stroke of n_frames evenly timed frames.

        Origin_um is what the encoder reads at its middle.
        """
        if n_frames < 2:
            raise ValueError(f"a stroke of {n_frames} frames: it takes 2 or more")
        x = np.linspace(-self.travel_mm / 2, self.travel_mm / 2, n_frames)
        self._lag = self._lag_at = None
        counts, place, depth = self._read(x, np.linspace(0, 1, n_frames))
        whole = np.clip(np.rint(counts), 0, MAX_COUNT).astype(np.uint16)
        times = np.rint(np.arange(n_frames) * 1e6 / frames_per_s).astype(np.int64)
        return FrameStream(
            packed=[pack(c) for c in whole],
            counts=whole if self.noise.quantise else counts,
            positions_um=place + origin_um,
            displacements_um=depth,
            times_us=times,
            truth=self.truth(x),
        )


def stroke_frames(
    stroke: Stroke | tuple[Stroke, Stroke] | StrokeField,
    noise: Noise | str = "none",
    seed: int = 0,
    n_frames: int = 50,
    **kwargs: Any,
) -> FrameStream:
    """One stroke of a seeded probe over a finite-element stroke (or the pair of two forces).

    Further words go to SensorModel (across_mm, mean_force_N_per_m, ...).
    """
    if isinstance(noise, str):
        if noise not in LEVELS:
            raise ValueError(f"no noise level '{noise}'; there are {', '.join(LEVELS)}")
        noise = LEVELS[noise]
    if isinstance(stroke, Stroke):
        stroke = StrokeField(stroke)
    elif isinstance(stroke, tuple):
        stroke = StrokeField(*stroke)
    return SensorModel(stroke, noise, seed, **kwargs).stroke(n_frames)
