"""What a source sends to the viewer. Units: mm, kPa, s; times are the probe's own unless the name says
host."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from palpate.across.layers import LumpLayer
from palpate.sim.probe.cells import FULL_SCALE_KPA, PITCH_MM


class LinkState(Enum):
    """Where the source stands."""

    CONNECTING = "connecting"
    CONNECTED = "connected"
    GONE = "gone"
    ENDED = "ended"


@dataclass(frozen=True)
class Device:
    """Who is at the other end: a probe, or the file that stands for it."""

    name: str
    serial: str = ""
    firmware: str = ""
    runtime: str = ""
    model_id: str = ""
    full_scale_kPa: float = FULL_SCALE_KPA
    damaged: tuple[str, ...] = ()
    reference: str | None = None
    """What the visit's reference press said, "" where there is none; None where the model takes none."""
    document: str = ""
    """Why the document that the user named is not used; "" where it is, or none was named."""


@dataclass(frozen=True)
class LinkChanged:
    """The link came, went, or cannot be had; `text` is the sentence to show."""

    state: LinkState
    text: str
    device: Device | None = None


@dataclass(frozen=True)
class Frame:
    """One tactile image, calibrated: `pressure_kPa` is rows x columns."""

    seq: int
    time_s: float
    host_time_s: float
    position_mm: float
    displacement_mm: float
    pressure_kPa: NDArray[np.float32]

    @property
    def force_N_per_m(self) -> float:
        """Force per metre of probe width: the pressures' integral along the stroke, mean over the columns."""
        return float(self.pressure_kPa.sum() * PITCH_MM / self.pressure_kPa.shape[1])


@dataclass(frozen=True)
class StrokeState:
    """The state of the stroke at this moment, as the probe reports it."""

    time_s: float
    contact: bool = False
    stroke: bool = False
    lump: bool = False
    force_low: bool = False
    force_high: bool = False
    too_fast: bool = False


@dataclass(frozen=True)
class MapFit:
    """Base + Amp exp(-(x - centre)^2 / (2 stdev^2)), kPa and mm."""

    base_kPa: float
    amp_kPa: float
    centre_mm: float
    stdev_mm: float


@dataclass(frozen=True)
class ProbeMap:
    """The finished stroke's tactile map as the probe computed it, of the columns from the first to before the
    second of `columns`: those that felt the lump."""

    x_mm: tuple[float, ...]
    pressure_kPa: tuple[float, ...]
    fit: MapFit | None = None
    columns: tuple[int, int] | None = None


@dataclass(frozen=True)
class Interval:
    """One number with the interval that holds it with the estimate's level."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Estimate:
    """The probe's answer after a stroke.

    `reference` is used, unlike (it does not fit, and was left out) or ""; `status_text` is empty, or says why
    there are no numbers; `further` holds outputs that have no field here; `width_mm` and `place_mm` are
    across the stroke, and the host's, as is `layer`, where the lump lies.
    """

    time_s: float
    F_N_per_m: Interval | None = None
    t_mm: Interval | None = None
    d_mm: Interval | None = None
    h: Interval | None = None
    E_inv23: Interval | None = None
    further: Mapping[str, Interval] = field(default_factory=dict)
    width_mm: Interval | None = None
    place_mm: Interval | None = None
    layer: LumpLayer | None = None
    outside: tuple[str, ...] = ()
    lump: bool = False
    hardness: str = "unsure"
    in_domain: bool = False
    force_out: bool = False
    uncalibrated: bool = False
    invalid: bool = False
    level: float = 0.0
    model_id: str = ""
    no_model: bool = False
    reference: str = ""
    status_text: str = ""


KNOWN = frozenset(f.name for f in fields(Estimate))


@dataclass(frozen=True)
class Health:
    """The link's counts since it came up."""

    frames_per_s: float = 0.0
    received: int = 0
    lost: int = 0
    crc_errors: int = 0
    resent: int = 0
    duplicates: int = 0
    dropped_by_probe: int = 0
    latency_ms: float | None = None


@dataclass(frozen=True)
class Mark:
    """A note that somebody set while recording."""

    time_s: float
    text: str


@dataclass(frozen=True)
class RecordingStopped:
    """The recording ended by itself (a full disk); what was written is kept."""

    text: str


@dataclass(frozen=True)
class Playback:
    """Where a replayed recording stands.

    `commands_applied` counts the play, pause, seek and speed commands: whoever sent the seventh knows that a
    state which counts fewer is out of date.
    """

    position_s: float
    length_s: float
    playing: bool
    speed: float
    commands_applied: int = 0
    strokes_s: tuple[float, ...] = field(default=())
    marks: tuple[Mark, ...] = field(default=())


@dataclass(frozen=True)
class Jumped:
    """The replay goes on from another position: what was under way will not be finished."""


Event = (
    LinkChanged
    | Frame
    | StrokeState
    | ProbeMap
    | Estimate
    | Health
    | Mark
    | Playback
    | Jumped
    | RecordingStopped
)
