"""What a probe sends, as typed values: the wire's integers, with properties in mm, kPa and text.

Units: mm, kPa, N per metre of probe width, microseconds of the probe's own clock (unwrapped).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from palpate.wire.frame import Event, Frame
from palpate.wire.results import HARDNESS, OUTPUTS, Estimate, Features, MapFit, TactileMap

__all__ = [
    "HARDNESS",
    "MARK_PREFIX",
    "OUTPUTS",
    "Answer",
    "Boot",
    "Estimate",
    "Event",
    "Features",
    "Frame",
    "Gap",
    "Log",
    "MapFit",
    "StreamEnd",
    "StrokeState",
    "TactileMap",
]


@dataclass(slots=True)
class StrokeState(Event):
    """A step of the stroke: contact, started, lump_passed, ended, force_low, force_high, too_fast, lifted."""

    event_seq: int
    stream: int
    stroke: int
    state: str
    time_us: int
    frame_seq: int
    value: int


@dataclass(slots=True)
class StreamEnd(Event):
    """The probe has ended a stream by itself.

    Parameters
    ----------
    stream : int
        Its number.
    reason : str
        "strokes": as many as were asked for; "lease": its host had not said a word for too long.
    next_seq, next_stroke : int
        The frame and the stroke that would have come next.
    """

    stream: int
    reason: str
    next_seq: int
    next_stroke: int
    time_us: int


MARK_PREFIX = "mark: "
"""Begins the lines of the log that people, and not the probe, have set."""


@dataclass(slots=True)
class Log(Event):
    """A line of the probe's log; level 0 info, 1 warning, 2 error."""

    level: int
    time_us: int
    text: str

    @property
    def mark(self) -> str | None:
        """What somebody noted while recording; None for a line of the probe's own."""
        return self.text.removeprefix(MARK_PREFIX) if self.text.startswith(MARK_PREFIX) else None


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
        The text of the error that started it.
    restarted : bool
        The probe was reset meanwhile: its numbers start again.
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
