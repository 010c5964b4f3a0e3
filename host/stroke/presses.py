"""Which frames of a session were the press before each stroke, as the probe itself told."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py import messages
from palpate.wire.events import Frame, StrokeState

_WRAP_EVENTS = 1 << 16
_STROKES_KEPT = 64


class Presses:
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
