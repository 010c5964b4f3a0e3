"""What the probe's sensors read during a finite-element stroke. Units: mm, kPa, N/m; frames in 12-bit counts.

A hand does not press evenly, a sensor is not its data sheet, and an encoder starts anywhere. `Noise` names
each of these; `SensorModel` is one physical probe in one hand; `stroke_frames` is one stroke of it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import calib, geometry
from palpate.errors import UsageError
from palpate.sim.probe.creep import Lag
from palpate.sim.probe.noise import LEVELS, WAVE_MM, Noise
from palpate.sim.probe.packed_frames import FrameStream, Truth
from palpate.sim.probe.source import FRAMES_PER_S
from palpate.sim.probe.stroke_field import FORCE_RATIO, StrokeField
from palpate.sim.tissue import Stroke
from palpate.wire.cells import COLUMN_MM, FULL_SCALE_KPA, PEDESTAL_KPA, SHAPE
from palpate.wire.packing import pack, unpack

__all__ = [
    "FORCE_RATIO",
    "LEVELS",
    "FrameStream",
    "Noise",
    "SensorModel",
    "StrokeField",
    "Truth",
    "pack",
    "stroke_frames",
    "unpack",
]

Floats = NDArray[np.float64]

PRESS_FRAMES = 24
"""Of a press, .64 s at the usual rate."""

AIR_FRAMES = 40
"""Of the probe in the air before a reference press."""

_LIFTED_FRAMES = 48
"""And after it: what the cells go on reading dies away, and the zero is seen again."""

_PRESS_FROM, _PRESS_MM_PER_S = 0.2, 60.0
_DEPTH_OVER_FORCE = 0.62
_AS_STIFFNESS = 0.67 / 0.62
"""The displacement goes as (F / E)^.62 t^.67: how much softer tissue is like how much thicker tissue."""


class SensorModel:
    """One probe (its gains, zeros and dead cells) in one hand (its wandering force) over one lump.

    Parameters
    ----------
    field : StrokeField
    noise : Noise
    seed : int
        Same seed, same probe, same hand, same stroke.
    across_mm : float, optional
        For a plane stroke that is to look like a ball's: standard deviation across the stroke of the extra
        pressure over that far from the lump (about 3.9). None makes all columns alike, as in plane strain.
    across_centre_mm : float
        Where such a lump lies across the probe.
    mean_force_N_per_m : float, optional
        The hand's mean force; by default the middle of the field's.
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
        if field.one_force and (noise.force or noise.undulation):
            raise UsageError(f"{field.low.code} was simulated at one force only: the hand cannot vary it")
        if len(field.shape) > 1 and across_mm is not None:
            raise UsageError(f"{field.low.code} has images across the stroke: their width cannot be chosen")
        self.field, self.noise, self.travel_mm = field, noise, travel_mm
        rng = self._rng = np.random.default_rng(seed)
        middle = field.middle_N_per_m
        self.mean_force_N_per_m = middle if mean_force_N_per_m is None else mean_force_N_per_m
        n = noise
        self.gain = 1 + n.gain * rng.standard_normal(SHAPE)
        self.gain *= 1 + n.row_gain * rng.standard_normal((geometry.ROWS, 1))
        # of a generator of its own: a seed gives the same probe as before in everything else
        self.gain *= 1 + n.common_gain * np.random.default_rng((seed, 1)).standard_normal()
        self.offset_kPa = n.offset * FULL_SCALE_KPA * rng.standard_normal(SHAPE)
        self.zero_kPa, self.zero_drift_kPa = n.drift * FULL_SCALE_KPA * rng.standard_normal(2) * (1, 2)
        self.dead = rng.random(SHAPE) < n.dead
        self.known_dead = self.dead & (rng.random(SHAPE) >= n.dead_unknown)
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
            self._across = np.exp(-((COLUMN_MM - across_centre_mm) ** 2) / (2 * across_mm**2))
        self._imperfect(np.random.default_rng((seed, 2)))
        if field.one_force:
            # moduli and force times s leave the displacement: so the one image that there is will do
            self.mean_force_N_per_m = field.low.F_N_per_m * self._stiffness
        self._lag = Lag()
        # pressing first changes nothing of what a seed gives in the stroke
        self._press_rng = np.random.default_rng((seed, 3))
        self._reference_rng = np.random.default_rng((seed, 4))

    def _imperfect(self, rng: np.random.Generator) -> None:
        """Draw what is wrong with probe and tissue as a whole, apart from the numbers drawn above."""
        n = self.noise
        self.stuck = (rng.random(SHAPE) < n.stuck) & ~self.dead
        zero = geometry.PEDESTAL_COUNTS + self.offset_kPa / FULL_SCALE_KPA * geometry.FULL_COUNT
        anywhere = geometry.FULL_COUNT * rng.random(SHAPE)
        self.stuck_counts = np.where(rng.random(SHAPE) < 0.5, zero, anywhere)
        self._stiffness = 1 + n.modulus * rng.standard_normal()
        self._wave_phase = rng.uniform(0, 2 * np.pi)

    def stiffness_at(self, stroke_mm: Floats) -> Floats:
        """The tissue's stiffness at places stroke_mm (n,), over what was simulated, (n,)."""
        swing = np.sin(2 * np.pi * np.asarray(stroke_mm, float) / WAVE_MM + self._wave_phase)
        return self._stiffness * (1 + self.noise.undulation * swing) ** -_AS_STIFFNESS

    def _sines(self, x: Floats) -> Floats:
        wave, phase, size = self._wave
        return (size * np.sin(2 * np.pi * np.asarray(x)[..., None] / wave + phase)).sum(-1)

    def calibration(self) -> calib.Calibration:
        """The factory calibration of this probe: nominal but for its known dead cells."""
        c = calib.Calibration()
        c.set_dead([int(i) for i in np.flatnonzero(self.known_dead)])
        return c

    def force_at(self, stroke_mm: Floats) -> Floats:
        """The hand's force in N/m, (n,), at places stroke_mm (n,) along the stroke (0: its middle)."""
        g = self._sines(np.asarray(stroke_mm, float)) / self._wave_peak
        return self.mean_force_N_per_m * (1 + self.noise.force * g)

    def pressures_at(self, stroke_mm: Floats) -> tuple[Floats, Floats]:
        """True pressures (n, rows, columns) in kPa and displacement (n,) in mm at places stroke_mm (n,)."""
        x = np.atleast_1d(np.asarray(stroke_mm, float))
        s = self.stiffness_at(x)  # moduli and forces times s leave the displacement, and pressures go times s
        force = None if self.field.one_force else self.force_at(x) / s
        image, depth = self.field.at(x + self.start_mm, force)
        image *= s.reshape(-1, *np.ones(image.ndim - 1, int))
        if len(self.field.shape) > 1:
            return image, depth
        if self._across is None:
            return np.repeat(image[:, :, None], geometry.COLUMNS, axis=2), depth
        far, far_depth = self.field.at(np.full_like(x, self.field.reach_mm[0]), force)
        far *= s[:, None]
        p = far[:, :, None] + (image - far)[:, :, None] * self._across
        # the long face bridges a ball: the probe hardly rises
        return np.maximum(p, 0), far_depth + 0.25 * (depth - far_depth)

    def counts_at(self, stroke_mm: float) -> tuple[NDArray[np.uint16], int, int]:
        """One live reading at a place along the stroke: counts (cells,), position and displacement in um."""
        counts, x, d = self._read(np.array([stroke_mm]), np.array([stroke_mm / self.travel_mm + 0.5]))
        return np.clip(np.rint(counts[0]), 0, geometry.FULL_COUNT).astype(np.uint16), int(x[0]), int(d[0])

    def _read(self, x: Floats, share: Floats) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
        p, depth = self.pressures_at(x)
        return self.felt(p, depth, x, share)

    def felt(
        self, pressure_kPa: Floats, displacement_mm: Floats, x: Floats, share: Floats
    ) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
        """What these sensors read of pressures (n, rows, columns) and displacements (n,), in this order.

        Parameters
        ----------
        x : (n,)
            Places along the stroke, mm; where the probe stands still, 60 mm for each second.
        share : (n,)
            How much of the stroke is over, 0 to 1: what drifts goes by it.

        Returns
        -------
        counts (n, cells) before they are rounded; positions and displacements (n,) in um
        """
        n, rng = self.noise, self._rng
        p, depth = pressure_kPa, displacement_mm
        if n.creep:
            p = p + n.creep * 2 * (self._lag.follow(p, x) - p)
        if n.hysteresis:
            most = np.maximum.accumulate(p, axis=0)
            p = p + 4 * n.hysteresis * p * (1 - p / np.maximum(most, 1e-9))
        p = p * self.gain + self.offset_kPa
        p += (self.zero_kPa + self.zero_drift_kPa * share)[:, None, None]
        if n.white:
            p += n.white * FULL_SCALE_KPA * rng.standard_normal(p.shape)
        counts = (p + PEDESTAL_KPA) / FULL_SCALE_KPA * geometry.FULL_COUNT
        counts[:, self.stuck] = self.stuck_counts[self.stuck]
        counts[:, self.dead] = 0
        depth = depth + self.displacement_zero_mm + self.displacement_drift_mm * (2 * share - 1)
        depth = depth + n.displacement_noise_mm * rng.standard_normal(len(x))
        place = x * self.position_scale + n.position_mm * rng.standard_normal(len(x))
        return (
            counts.reshape(len(x), -1),
            np.rint(place * 1e3).astype(np.int64),
            np.rint(depth * 1e3).astype(np.int64),
        )

    def truth(self, stroke_mm: Floats) -> Truth:
        """The inputs that a stroke through the places stroke_mm (n,) is to be inverted to."""
        c = self.field.low.case
        F = self.mean_force_N_per_m if self.field.one_force else float(np.mean(self.force_at(stroke_mm)))
        return Truth(c, F, -self.start_mm, float(np.mean(self.stiffness_at(stroke_mm))))

    def _press(
        self, frames: int, frames_per_s: float, field: StrokeField | None
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Counts (frames, cells) and displacements in um (frames,) while the hand presses to its force."""
        field = field or self.field
        start = -self.travel_mm / 2
        force = float(self.force_at(np.array([start]))[0]) * np.linspace(_PRESS_FROM, 1.0, frames)
        image, depth = self._pressed(field, force, start)
        seconds = (np.arange(frames) - frames) / frames_per_s
        strokes_rng, self._rng = self._rng, self._press_rng
        counts, _, depth_um = self.felt(image, depth, start + _PRESS_MM_PER_S * seconds, np.zeros(frames))
        self._rng = strokes_rng
        return counts, depth_um

    def _pressed(self, field: StrokeField, force_N_per_m: Floats, place_mm: float) -> tuple[Floats, Floats]:
        """Pressures (n, rows, columns) and displacements (n,) where `field` begins, under forces (n,)."""
        stiffness = float(self.stiffness_at(np.array([place_mm]))[0])
        force = np.asarray(force_N_per_m, float) / stiffness
        least = field.forces_N_per_m[0]
        image, depth = field.at(
            np.full(len(force), field.reach_mm[0]), None if field.one_force else np.maximum(force, least)
        )
        share = np.minimum(force / least, 1.0)
        image *= stiffness * share.reshape(-1, *np.ones(image.ndim - 1, int))
        if image.ndim < 3:
            image = np.repeat(image[:, :, None], geometry.COLUMNS, axis=2)
        return image, depth * share**_DEPTH_OVER_FORCE

    def reference(self, pressed: StrokeField, force_N_per_m: float, *, place_mm: float = 0.0) -> FrameStream:
        """A press beside the lump: from the air straight down to this force, held, and lifted again.

        Parameters
        ----------
        pressed : StrokeField
            What is under the probe: one position at rising forces.
        place_mm : float
            Where that is along the stroke's line: the tissue's thickness and stiffness there are its own.
        """
        air, held = AIR_FRAMES, PRESS_FRAMES // 6
        force = force_N_per_m * np.concatenate([np.linspace(_PRESS_FROM, 1.0, PRESS_FRAMES), np.ones(held)])
        image, depth = self._pressed(pressed, force, place_mm)
        image = np.concatenate([image, np.zeros((_LIFTED_FRAMES, *image.shape[1:]))])
        depth = np.concatenate([depth, np.zeros(_LIFTED_FRAMES)])
        strokes_rng, self._rng = self._rng, self._reference_rng
        moves_mm = _PRESS_MM_PER_S / FRAMES_PER_S
        nothing = np.zeros((air, *image.shape[1:]))
        share: Floats = (np.arange(-air, 0) / len(depth)).astype(np.float64)
        along: Floats = place_mm + moves_mm * np.arange(air, dtype=np.float64)
        counts, _, depth_um = self.felt(nothing, np.zeros(air), along, share)
        self._lag = Lag()  # begins at the first force, as in `_press`
        stream = self._frames(
            np.full(len(depth), place_mm), image, depth, FRAMES_PER_S, (counts, depth_um), moves_mm
        )
        self._rng = strokes_rng
        return replace(stream, press=0, truth=replace(stream.truth, F_N_per_m=force_N_per_m))

    def stroke(
        self,
        n_frames: int = 50,
        frames_per_s: float = FRAMES_PER_S,
        *,
        press: int = 0,
        pressed: StrokeField | None = None,
    ) -> FrameStream:
        """A whole stroke of n_frames evenly timed frames.

        Parameters
        ----------
        press : int
            So many frames more before it: the probe stands where it will begin, and the hand's force rises
            from a fifth to all of what it is there.
        pressed : StrokeField, optional
            What is under the probe then: one position at rising forces, the least about a fifth of the
            greatest. By default the stroke's own begin. Below the least of its forces the image keeps its
            shape.
        """
        if n_frames < 2:
            raise UsageError(f"a stroke of {n_frames} frames: it takes 2 or more")
        x = np.linspace(-self.travel_mm / 2, self.travel_mm / 2, n_frames)
        self._lag = Lag()
        before = self._press(press, frames_per_s, pressed) if press else None
        return self._frames(x, *self.pressures_at(x), frames_per_s, before)

    def untouched(self, n_frames: int = 50) -> FrameStream:
        """Frames of the probe lying in the air: its noise, its zeros, its dead cells."""
        x = np.zeros(n_frames)
        frames = self._frames(x, np.zeros((n_frames, *SHAPE)), x, FRAMES_PER_S)
        return replace(frames, positions_um=np.zeros_like(frames.positions_um))  # nobody turns the wheel

    def _frames(
        self,
        x: Floats,
        pressure_kPa: Floats,
        displacement_mm: Floats,
        frames_per_s: float,
        before: tuple[Floats, NDArray[np.int64]] | None = None,
        moves_mm: float = 0.0,
    ) -> FrameStream:
        """Evenly timed frames of pressures (n, rows, columns) and displacements (n,) at places x (n,).

        before : counts (m, cells) and displacements in um (m,) of a press where they begin.
        moves_mm : what stands for the time of a frame where the probe stands still, see `felt`
        """
        along = x + moves_mm * np.arange(len(x))
        counts, place, depth = self.felt(pressure_kPa, displacement_mm, along, np.linspace(0, 1, len(x)))
        if moves_mm:
            place = np.full_like(place, place[0])
        press = 0
        if before is not None:
            press = len(before[0])
            counts, depth = np.concatenate([before[0], counts]), np.concatenate([before[1], depth])
            place = np.concatenate([np.full(press, place[0]), place])
        whole = np.clip(np.rint(counts), 0, geometry.FULL_COUNT).astype(np.uint16)
        times = np.rint(np.arange(len(place)) * 1e6 / frames_per_s).astype(np.int64)
        return FrameStream(
            packed=[pack(c) for c in whole],
            counts=whole if self.noise.quantise else counts,
            positions_um=place,
            displacements_um=depth,
            times_us=times,
            truth=self.truth(x),
            press=press,
        )


def stroke_frames(
    stroke: Stroke | tuple[Stroke, ...] | StrokeField,
    noise: Noise | str = "none",
    seed: int = 0,
    n_frames: int = 50,
    **kwargs: Any,
) -> FrameStream:
    """One stroke of a seeded probe over a finite-element stroke (or several of rising forces).

    Further arguments go to SensorModel (across_mm, mean_force_N_per_m, ...).
    """
    if isinstance(noise, str):
        if noise not in LEVELS:
            raise UsageError(f"no noise level '{noise}'; there are {', '.join(LEVELS)}")
        noise = LEVELS[noise]
    if isinstance(stroke, Stroke):
        stroke = StrokeField(stroke)
    elif isinstance(stroke, tuple):
        stroke = StrokeField(*stroke)
    return SensorModel(stroke, noise, seed, **kwargs).stroke(n_frames)
