"""What a probe has computed from a stroke: its tactile map, its features, its estimate.

Units: mm, kPa, N per metre of probe width; the wire's integers have theirs in their names.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from firmware_py import messages, outputs, status
from palpate.spans import Span, depth_mm, stiffness
from palpate.wire.damage import damage_words
from palpate.wire.frame import Event

OUTPUTS = outputs.NAMES
"""Names of an estimate's outputs, in the order of the wire, which carries millionths of these units."""

HARDNESS = {outputs.SOFT: "soft", outputs.HARD: "hard"}


@dataclass(frozen=True)
class MapFit:
    """Base + Amp exp(-(x - centre)^2 / (2 stdev^2)), kPa and mm."""

    base_kPa: float
    amp_kPa: float
    centre_mm: float
    stdev_mm: float


@dataclass(slots=True)
class TactileMap(Event):
    """The stroke's mean tactile map as the probe computed it, with its Gaussian fit, in the wire's integers.

    Parameters
    ----------
    stream, stroke, status : int
        Number of the stream and of the stroke; 0 or why there is no fit.
    first_column, end_column : int
        The columns used: the first, and one after the last.
    points, first_mm, place_um : int
        Values, 1 mm apart, the first at `first_mm` from `place_um`, the lump's place along the stroke.
    count_mpa : int
        Pressure of one count, millipascal.
    base_q11, amplitude_q11, centre_q16, stdev_q16 : int
        The fit: counts with 11 fraction bits; mm from the map's first point, and mm, with 16.
    values : tuple of int
        The map, counts with 11 fraction bits.
    """

    stream: int
    stroke: int
    status: int
    first_column: int
    end_column: int
    points: int
    first_mm: int
    place_um: int
    count_mpa: int
    base_q11: int
    amplitude_q11: int
    centre_q16: int
    stdev_q16: int
    values: tuple[int, ...]

    @property
    def unit_kPa(self) -> float:
        """Pressure of one unit of `values`, kPa."""
        return self.count_mpa / 2**11 / 1e6

    @property
    def usable(self) -> bool:
        """False of a stroke that was too short for a map."""
        return bool(self.values) and self.status in (status.OK, status.NO_FIT)

    @property
    def x_mm(self) -> list[float]:
        """Places along the stroke, one for each value."""
        return [self._zero_mm + i for i in range(len(self.values))]

    @property
    def pressure_kPa(self) -> list[float]:
        """The map."""
        return [value * self.unit_kPa for value in self.values]

    @property
    def fit(self) -> MapFit | None:
        """The bump; None where the probe fitted none."""
        return self._fit if self.status == status.OK and self.stdev_q16 > 0 else None

    @property
    def _zero_mm(self) -> float:
        return self.first_mm + self.place_um / 1000

    @property
    def _fit(self) -> MapFit:
        return MapFit(
            self.base_q11 * self.unit_kPa,
            self.amplitude_q11 * self.unit_kPa,
            self._zero_mm + self.centre_q16 / 2**16,
            self.stdev_q16 / 2**16,
        )

    def as_dict(self) -> dict[str, Any]:
        """The map in mm and kPa; `x_mm` are places along the stroke."""
        fit = self._fit
        return {
            "stroke": self.stroke,
            "x_mm": self.x_mm,
            "pressure_kPa": self.pressure_kPa,
            "base_kPa": fit.base_kPa,
            "amplitude_kPa": fit.amp_kPa,
            "centre_mm": fit.centre_mm,
            "stdev_mm": fit.stdev_mm,
            "columns": [self.first_column, self.end_column],
            "status": self.status,
        }


@dataclass(slots=True)
class Features(Event):
    """The features the probe computed of a stroke, Q24 integers in the order of `firmware_py.features`."""

    stream: int
    stroke: int
    status: int
    version: int
    values: tuple[int, ...]


@dataclass
class Estimate(Event):
    """The probe's answer for one stroke.

    Parameters
    ----------
    stream : int
        Number of the stream in which it was stroked; no other stream of the probe has it.
    stroke : int
        Number of the stroke since the probe started.
    status : int
        0, or the reason of `firmware_py.status` why there is no estimate.
    flags : int
        lump, in_domain, hardness, force, invalid (the bits of `firmware_py.outputs`).
    damage : int
        What the probe had found damaged in its store (`firmware_py.messages.DAMAGED_*`).
    level_permille : int
        Coverage of the intervals.
    distance_permille : int
        How far from the training strokes, in thousandths of the domain's threshold (over 1000: outside).
    model_id : bytes
        First 8 bytes of the model image's hash.
    frames, first_seq, last_seq : int
        The frames it rests on: so many from `first_seq` on, all before `last_seq`.
    overrun : int
        Frames that the probe's sensors were too late for during the stroke.
    values : tuple of int
        Value, low, high of each of `OUTPUTS`, in millionths; empty without estimate.
    """

    stream: int
    stroke: int
    status: int
    flags: int
    damage: int
    level_permille: int
    distance_permille: int
    model_id: bytes
    frames: int
    first_seq: int
    last_seq: int
    overrun: int
    time_us: int
    values: tuple[int, ...] = field(default=())

    @property
    def lump(self) -> bool:
        """True where the stroke shows a lump that the model can size."""
        return bool(self.flags & outputs.LUMP)

    @property
    def in_domain(self) -> bool:
        """True where the stroke lies inside what the model was trained on."""
        return bool(self.flags & outputs.IN_DOMAIN)

    @property
    def reference(self) -> str:
        """used: the visit's reference press is in it; unlike: it does not fit, and is not; or ""."""
        if self.flags & outputs.REFERENCE_OFF:
            return "unlike"
        return "used" if self.flags & outputs.REFERENCE else ""

    @property
    def valid(self) -> bool:
        """False where the numbers mean nothing (then `reason` says why)."""
        return self.status == status.OK and not self.flags & outputs.INVALID

    @property
    def unread(self) -> bool:
        """True where the stroke could not be read: no numbers, and no lump or force to blame it on."""
        return not self.valid and self.status not in (status.NO_LUMP, status.NO_FIT, status.FORCE_RANGE)

    @property
    def force_out(self) -> bool:
        """True where the force was outside what the model was fitted to."""
        return bool(self.flags & outputs.FORCE_OUT)

    @property
    def calibrated(self) -> bool:
        """False where the probe had lost its calibration, and used nominal values."""
        return not self.damage & messages.DAMAGED_CALIBRATION

    @property
    def hardness(self) -> str:
        """hard, soft, or unsure."""
        return HARDNESS.get(self.flags & (outputs.SOFT | outputs.HARD), "unsure")

    @property
    def reason(self) -> str:
        """Why there is no estimate, as text; "ok" where there is one."""
        return status.TEXT.get(self.status, f"status {self.status}")

    @cached_property
    def outputs(self) -> dict[str, dict[str, float]]:
        """`value`, `low`, `high` of every output that the model tells, in the units of its name."""
        values = self.values
        said = self.valid and self.lump
        return {
            name: {part: values[3 * i + k] / outputs.SCALE for k, part in enumerate(outputs.PARTS)}
            for i, name in enumerate(OUTPUTS)
            if 3 * i + 2 < len(values) and not (said and values[3 * i + 1] >= -1 and values[3 * i + 2] <= 1)
        }

    def span(self, name: str) -> Span:
        """Value, low and high of one output."""
        of = self.outputs[name]
        return of["value"], of["low"], of["high"]

    @property
    def depth_mm(self) -> Span | None:
        """Fat over the lump as value, low, high; None where the model does not say t, d and h."""
        if not {"t_mm", "d_mm", "h"} <= self.outputs.keys():
            return None
        return depth_mm(self.span("t_mm"), self.span("d_mm"), self.span("h"))

    def fat_kPa(self, told: float | None = None) -> Span | None:
        """The fat's modulus as value, low, high: what was told, or else estimated; None where neither is."""
        if told is not None:
            return told, told, told
        if "E_fat_kPa" not in self.outputs:
            return None
        value, low, high = self.span("E_fat_kPa")
        return (value, low, high) if 0 < low <= value <= high else None

    @property
    def numbers(self) -> tuple[Any, ...]:
        """Everything that a replay must reproduce bit for bit."""
        return (
            self.status,
            self.flags,
            self.level_permille,
            self.distance_permille,
            self.model_id.hex(),
            self.frames,
            *self.values,
        )

    def as_dict(self) -> dict[str, Any]:
        """The estimate as `--json` prints it."""
        words: dict[str, Any] = dict(self.outputs)
        parts = ("value", "low", "high")
        if (depth := self.depth_mm) is not None:
            words["depth_mm"] = dict(zip(parts, depth))
        if "E_inv23" in self.outputs:  # null where there is no bound
            words["E_ratio"] = dict(zip(parts, stiffness(self.span("E_inv23"))))
        words.update(
            lump=self.lump,
            hardness=self.hardness,
            in_domain=self.in_domain,
            level=self.level_permille / 1000,
            model_id=self.model_id.hex(),
            valid=self.valid,
            reference=self.reference,
            force_in_range=not self.force_out,
            status=self.status,
            reason=self.reason,
            stream=self.stream,
            stroke=self.stroke,
            damaged=damage_words(self.damage),
            frames=self.frames,
            frames_overrun=self.overrun,
            domain_distance=self.distance_permille / 1000,
            first_seq=self.first_seq,
            last_seq=self.last_seq,
            time_us=self.time_us,
        )
        return words
