"""What a source tells the viewer beside the events of the wire. Units: kPa, s."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Any


def sentence(error: Exception) -> str:
    """What went wrong, as a sentence of its own."""
    text = str(error).rstrip(".")
    return f"{text[:1].upper()}{text[1:]}."


class LinkState(Enum):
    """Where the source stands."""

    CONNECTING = "connecting"
    CONNECTED = "connected"
    GONE = "gone"
    ENDED = "ended"


@dataclass(frozen=True)
class OtherEnd:
    """Who is at the other end: a probe, or the file that stands for it."""

    name: str
    serial: str = ""
    firmware: str = ""
    runtime: str = ""
    model_id: str = ""
    damaged: tuple[str, ...] = ()
    reference: str | None = None
    """What the visit's reference press said, "" where there is none; None where the model takes none."""
    force_range: tuple[float, float] | None = None
    """N/m that the model is for; None where its document is not known."""
    document: str = ""
    """Why the document that the user named is not used; "" where it is, or none was named."""


@dataclass(frozen=True)
class LinkChanged:
    """The link came, went, or cannot be had; `text` is the sentence to show."""

    state: LinkState
    text: str
    device: OtherEnd | None = None


@dataclass(frozen=True)
class Health:
    """The link's counts since it came up."""

    frames_per_s: float = 0.0
    lost: int = 0
    crc_errors: int = 0
    resent: int = 0
    latency_ms: float | None = None


@dataclass(frozen=True)
class Mark:
    """A note that somebody set while recording, for the replay's ticks."""

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


@dataclass(frozen=True)
class Refined:
    """A stroke is being fitted by the finite-element model, or was; `card` is what the page shows of it.

    `estimate_us` is the probe's time of the stroke's estimate.
    """

    estimate_us: int
    card: dict[str, Any]


Notice = LinkChanged | Health | Playback | Jumped | RecordingStopped | Refined
