"""The frames of a session's strokes, and of the presses before them, as the probe itself told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from firmware_py import messages
from firmware_py.pipeline import Pipeline
from palpate.wire.events import Estimate, Event, Frame, StrokeState

FRAMES_KEPT = 1 << 16
"""More than a stroke has; 41 MB."""
_WRAP_EVENTS = 1 << 16
_STROKES_KEPT = 64


@dataclass(frozen=True)
class StrokeFrames:
    """What there is of a stroke.

    Attributes
    ----------
    stroke : list of Frame
        Frames that its estimate rests on, in order.
    missing : int
        How many more it rests on.
    press : list of Frame or None
        Those between contact and its start; None where some are missing, or nobody knows which.
    """

    stroke: list[Frame]
    missing: int
    press: list[Frame] | None

    def push(self, pipeline: Pipeline, force_map: object | None) -> int:
        """Push the press and then the stroke through the firmware's own pipeline; its status
        (`firmware_py.status`)."""
        pipeline.begin_press()
        for frame in self.press or ():
            pipeline.add_press(frame.packed, frame.displacement_um)
        pipeline.reset()
        for frame in self.stroke:
            pipeline.add_frame(frame.packed, frame.position_um, frame.displacement_um)
        return int(pipeline.finish(force_map))


class SessionFrames:
    """Takes every event of a session, live or recorded; `of` then finds the frames of a stroke."""

    def __init__(self) -> None:
        self._frames: dict[int, Frame] = {}
        self._presses = _Presses()

    def take(self, event: Event) -> None:
        """The next event."""
        if isinstance(event, Frame):
            self._frames[event.seq] = event
            if len(self._frames) > FRAMES_KEPT:
                del self._frames[next(iter(self._frames))]
        elif isinstance(event, StrokeState):
            self._presses.take(event)

    def of(self, said: Estimate) -> StrokeFrames:
        """The frames of the stroke that an estimate, the latest event, is of."""
        numbers = [(said.first_seq + k) % messages.WRAP for k in range(said.frames)]
        stroke = [self._frames[seq] for seq in numbers if seq in self._frames]
        press = self._presses.of(said.stream, said.stroke, self._frames)
        return StrokeFrames(stroke, len(numbers) - len(stroke), press)

    def between(self, first: int, last: int) -> list[Frame]:
        """The frames from one sequence number to another that are there, in order."""
        numbers = ((first + k) % messages.WRAP for k in range((last - first) % messages.WRAP + 1))
        return [self._frames[seq] for seq in numbers if seq in self._frames]

    def forget(self) -> None:
        """Where the probe has started anew: its numbers begin again."""
        self._frames.clear()


class _Presses:
    """Watches the stroke states go by; `of` then names a stroke's frames between contact and its start.

    A stroke that begins without the probe having been lifted has the press of the one before.
    """

    def __init__(self) -> None:
        self._contact: int | None = None
        self._now: range | None = None
        self._next_event: int | None = None
        self._of: dict[tuple[int, int], range | None] = {}

    def take(self, event: StrokeState) -> None:
        """The next state."""
        if event.event_seq != self._next_event:  # one was lost, perhaps the contact's
            self._contact = self._now = None
        self._next_event = (event.event_seq + 1) % _WRAP_EVENTS
        if event.state == "contact":
            self._contact, self._now = event.frame_seq, None
        elif event.state == "started":
            if self._contact is not None:
                frames = (event.frame_seq - self._contact) % messages.WRAP
                self._now, self._contact = range(self._contact, self._contact + frames), None
            self._of[event.stream, event.stroke] = self._now
            while len(self._of) > _STROKES_KEPT:
                del self._of[next(iter(self._of))]

    def of(self, stream: int, stroke: int, frames: Mapping[int, Frame]) -> list[Frame] | None:
        """The frames of a stroke's press, in order; None where some are missing, or nobody knows which.

        Parameters
        ----------
        frames : by their sequence numbers
        """
        numbers = self._of.get((stream, stroke))
        if numbers is None:
            return None
        found = [frames[seq % messages.WRAP] for seq in numbers if seq % messages.WRAP in frames]
        return found if len(found) == len(numbers) else None
