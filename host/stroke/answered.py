"""A probe's estimate with what the host adds to it, held back until the stroke's map has come."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from palpate.stroke.follower import Follower
from palpate.wire.events import Estimate, Event, Frame, Gap, StrokeState, TactileMap

if TYPE_CHECKING:
    from palpate.answer.told import Told

MAP_PATIENCE_US = 2_000_000
"""How long an estimate that has come waits for its map, which comes behind it, in the probe's time."""


@dataclass(slots=True)
class Answered(Event):
    """The answer to a stroke: the probe's, and what the host adds to it (None: nothing)."""

    estimate: Estimate
    told: Told | None = None


class AnsweredEvents:
    """A probe's events in, the same out, but for estimates: each comes behind its map, as `Answered`.

    Parameters
    ----------
    follower : Follower, optional
        Gets every event, and works out what the host adds.
    """

    def __init__(self, follower: Follower | None = None) -> None:
        self._follower = follower
        self._map_of = (0, 0)
        self._held: Estimate | None = None
        self._held_from_us: int | None = None  # first frame since; a slow probe answers long after its stroke

    def feed(self, event: Event) -> Iterator[Event]:
        """Take the next event."""
        if self._follower is not None:
            self._follower.take(event)
        if isinstance(event, Estimate):
            yield from self.finish()
            self._held, self._held_from_us = event, None
            if self._is_of(self._map_of):
                yield from self.finish()
            return
        if (
            isinstance(event, Gap)
            or (isinstance(event, StrokeState) and event.state == "started")
            or (isinstance(event, Frame) and self._waits_in_vain(event))
        ):
            yield from self.finish()
        yield event
        if isinstance(event, TactileMap):
            self._map_of = event.stream, event.stroke
            if self._is_of(self._map_of):
                yield from self.finish()

    def finish(self) -> Iterator[Answered]:
        """Hand on the estimate that waits for its map: it has come, or will not."""
        if (held := self._held) is not None:
            self._held = None
            yield Answered(held.host_ns, held, None if self._follower is None else self._follower.of(held))

    def forget(self) -> None:
        """Somebody moved along a recording: the estimate that waits is of another place."""
        self._held = None

    def _is_of(self, stroke: tuple[int, int]) -> bool:
        return self._held is not None and (self._held.stream, self._held.stroke) == stroke

    def _waits_in_vain(self, frame: Frame) -> bool:
        if self._held is None:
            return False
        if self._held_from_us is None:
            self._held_from_us = frame.time_us
        return frame.time_us - self._held_from_us > MAP_PATIENCE_US
