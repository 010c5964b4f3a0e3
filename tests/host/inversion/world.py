"""Strokes to be inverted: computed on a mesh that the inversion does not use, every frame at its own place
and under its own force, then felt by an emulated probe's sensors."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from firmware_py import calib
from palpate.inversion.felt import FeltStroke, felt_press, felt_stroke
from palpate.inversion.start import Pressed, Start, Stroked, start_of
from palpate.link.face import Face
from palpate.models import ANYWHERE, BALLS
from palpate.sim.probe.noise import Noise, level_named
from palpate.sim.probe.packed_frames import FrameStream
from palpate.sim.probe.sensors import PRESS_FRAMES, SensorModel
from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.frames import solve_frames
from palpate.sim.tissue.geometry import geometry_of
from palpate.wire.cells import FULL_SCALE_KPA, PEDESTAL_KPA, SHAPE

WORLD = Settings(
    hx_mm=0.4, shells=4, row_mm=2.8, gland_row_mm=4.0, skin_mm=(0.25, 0.4, 0.6), to_border=True
)  # fmt: skip
_SPAN_MM = (-46.0, 46.0)


class ExactField:
    """As a `StrokeField`, but nothing is interpolated: the solver is asked for every place and force."""

    one_force, shape, press = False, (16,), None

    def __init__(self, case: Case, settings: Settings = WORLD) -> None:
        self._case, self._settings = case, settings
        self._geometry = geometry_of(case, settings, *_SPAN_MM)
        self.low = SimpleNamespace(case=case, code=case.code)
        self.middle_N_per_m = case.F_N_per_m
        self.forces_N_per_m = self.middle_N_per_m * np.array([1e-3, 1e3])
        self.reach_mm = _SPAN_MM

    def at(self, position_mm, force_N_per_m):
        """Images (n, 16) and displacements (n,)."""
        x = np.asarray(position_mm, float)
        forces = np.broadcast_to(np.asarray(force_N_per_m, float), x.shape)
        found = solve_frames(self._case, self._settings, self._geometry, x, forces)
        return found.images_kPa, found.displacement_mm


class TwoAlike(ExactField):
    """Over two such lumps: what each changes over plain tissue is added up, as `sim.probe.two_lumps` does."""

    def __init__(self, case: Case, apart_mm: float) -> None:
        super().__init__(case)
        self._apart_mm = apart_mm

    def at(self, position_mm, force_N_per_m):
        """As `ExactField.at`."""
        x = np.asarray(position_mm, float)
        far = np.full_like(x, _SPAN_MM[0] + 8.0)
        places = (x + self._apart_mm / 2, x - self._apart_mm / 2, far)
        one, other, plain = (ExactField.at(self, place, force_N_per_m) for place in places)
        return tuple(a + b - c for a, b, c in zip(one, other, plain))


def felt_of(
    case: Case, seed: int, noise: str | Noise = "typical", probe: int | None = None,
    field: ExactField | None = None,
) -> tuple[FeltStroke, Start, FrameStream, calib.Calibration]:  # fmt: skip
    """One stroke over a lump by a probe and a hand of this seed, or by the probe of another."""
    field = field or ExactField(case)
    level = level_named(noise) if isinstance(noise, str) else noise
    sensors = SensorModel(field, level, seed)  # type: ignore[arg-type]
    if probe is not None:
        of_probe(sensors, SensorModel(field, level, probe))  # type: ignore[arg-type]
    field.reach_mm = (-40.0 + sensors.start_mm, 44.0)  # the press stands where the stroke begins
    stream = sensors.stroke(press=PRESS_FRAMES)
    felt, start = of_stream(stream, sensors.calibration())
    return felt, start, stream, sensors.calibration()


def of_probe(sensors: SensorModel, other: SensorModel) -> None:
    """Let a hand hold the probe of another."""
    for name in ("gain", "dead", "known_dead", "position_scale"):
        setattr(sensors, name, getattr(other, name))


def press_and_frames(stream: FrameStream) -> tuple[Pressed, Stroked]:
    """A stream as models take it."""
    p = stream.press
    return (
        (stream.packed[:p], stream.displacements_um[:p].tolist()),
        (stream.packed[p:], stream.positions_um[p:], stream.displacements_um[p:]),
    )


def of_stream(stream: FrameStream, calibration: calib.Calibration) -> tuple[FeltStroke, Start]:
    """What the inversion takes of a stream."""
    p = stream.press
    counts = np.clip(np.rint(stream.counts), 0, 4095).reshape(-1, *SHAPE)
    felt = felt_stroke(
        counts / 4095 * FULL_SCALE_KPA - PEDESTAL_KPA,
        (counts == 0).all(0),
        stream.displacements_um / 1e3,
        stream.positions_um / 1e3,
        stream.times_us / 1e6,
        p,
    )
    start = start_of(
        0,
        *press_and_frames(stream),
        calibration,
        0.0,
        BALLS if felt.solid else ANYWHERE,
    )
    return felt, start


def in_fat_of(case: Case, fat_kPa: float) -> Case:
    """The same stroke in softer or stiffer fat: moduli and force alike."""
    return replace(case, fat_kPa=fat_kPa, F_rel=case.F_rel * fat_kPa / case.fat_kPa)


def press_of(
    case: Case, seed: int, noise: str = "typical", beside_mm: float = 0.0, measured: bool = True,
    face: Face | None = None,
) -> FeltStroke:  # fmt: skip
    """One press beside a lump's middle, from a tenth of the force to all of it, by a probe of this seed."""
    field = ExactField(case)
    field.press = None
    sensors = SensorModel(field, level_named(noise), seed)  # type: ignore[arg-type]
    force = case.F_N_per_m * np.linspace(0.1, 1.0, PRESS_FRAMES)
    image, depth = field.at(np.full(PRESS_FRAMES, beside_mm), force)
    time_s = np.arange(PRESS_FRAMES) / 37.5
    image = np.repeat(image[:, :, None], SHAPE[1], axis=2)
    counts, _, depth_um = sensors.felt(image, depth, 60.0 * time_s, np.zeros(PRESS_FRAMES))
    counts = np.clip(np.rint(counts), 0, 4095).reshape(-1, *SHAPE)
    return felt_press(
        counts / 4095 * FULL_SCALE_KPA - PEDESTAL_KPA,
        (counts == 0).all(0),
        depth_um / 1e3 if measured else np.zeros(PRESS_FRAMES),
        time_s,
        1,
        face,
    )
