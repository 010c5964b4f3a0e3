"""What a probe tells, as typed values: the wire's integers, with properties in mm, kPa and words.

Units: mm, kPa, N per metre of probe width, microseconds of the probe's own clock (unwrapped).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from host.link.frames import Event, Frame, unpack_counts
from host.link.results import HARDNESS, OUTPUTS, Estimate, Features, TactileMap

__all__ = [
    "HARDNESS",
    "OUTPUTS",
    "Answer",
    "Boot",
    "Estimate",
    "Event",
    "Features",
    "Frame",
    "Gap",
    "Log",
    "StrokeState",
    "TactileMap",
    "unpack_counts",
]


@dataclass(slots=True)
class StrokeState(Event):
    """A step of the stroke: contact, started, lump_passed, ended, force_low, force_high, too_fast, lifted."""

    event_seq: int
    stroke: int
    state: str
    time_us: int
    frame_seq: int
    value: int


@dataclass(slots=True)
class Log(Event):
    """A line of the probe's log; level 0 info, 1 warning, 2 error."""

    level: int
    time_us: int
    text: str


@dataclass(slots=True)
class Boot(Event):
    """The probe has (re)started; `boots` counts its starts."""

    boots: int
    status: int


@dataclass(slots=True)
class Gap(Event):
    """The link was down. Sent when it is up again, or, with `ended` False, when it went down.

    Parameters
    ----------
    seconds : float
        How long, on the host's clock.
    reason : str
        The sentence of the error that began it.
    restarted : bool
        The probe was reset meanwhile: its numbers begin anew.
    """

    seconds: float
    reason: str
    ended: bool = True
    restarted: bool = False


@dataclass(slots=True)
class Answer(Event):
    """The answer to a command: its name, id, status and fields."""

    kind: int
    message_id: int
    status: int
    values: tuple[Any, ...]
