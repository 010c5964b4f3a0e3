"""Events in, finished strokes out: the same for a live probe and for a recording read ahead."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from palpate.view.events import Estimate, Event, Frame, Mark, ProbeMap, StrokeState
from palpate.view.lanes import lane_of
from palpate.view.stroke import Stroke

PRE_ROLL = 64
"""Frames kept between contact and start: the probe reports "started" some frames late."""

_SAME_S = 0.01


class Assembler:
    """Puts frames, states, map and estimate of one stroke together.

    Parameters
    ----------
    new_stroke : callable
        Makes a stroke that starts at a device time, s.
    """

    def __init__(self, new_stroke: Callable[[float], Stroke]) -> None:
        self._new_stroke = new_stroke
        self.running: Stroke | None = None
        self.waiting: Stroke | None = None
        """The stroke is over, its estimate has not come."""
        self._begun: deque[Stroke] = deque(maxlen=4)
        self._before: deque[Frame] = deque(maxlen=PRE_ROLL)
        self._contact = False

    def feed(self, event: Event) -> Stroke | None:
        """Take one event; returns the stroke that it finishes, if it finishes one."""
        if isinstance(event, Frame):
            if self.running is not None:
                self.running.add(event)
            elif self._contact:
                self._before.append(event)
        elif isinstance(event, StrokeState):
            return self._state(event)
        elif isinstance(event, ProbeMap):
            if (stroke := self.waiting or self.running) is not None:
                stroke.probe_map = event
        elif isinstance(event, Mark):
            self._tell_lane(event.text)
        elif isinstance(event, Estimate):
            stroke = self.waiting or self.running or self._begin(event.time_s)
            stroke.estimate = event
            if stroke is self.running:
                self.running = None
            self.waiting = None
            return stroke
        return None

    def give_up(self) -> Stroke | None:
        """The link broke, or the file ended: no more of this stroke will come; returns one that was over."""
        stroke, self.waiting, self.running, self._contact = self.waiting, None, None, False
        self._before.clear()
        return stroke

    def _begin(self, started_s: float) -> Stroke:
        stroke = self._new_stroke(started_s)
        self._begun.append(stroke)
        return stroke

    def _tell_lane(self, mark: str) -> None:
        """Where a recorded mark tells a stroke's lane: of a busy machine it may stand behind its end."""
        if (told := lane_of(mark)) is None:
            return
        lane_mm, started_s = told
        for stroke in self._begun:
            if abs(stroke.started_s - started_s) < _SAME_S:
                stroke.lane_mm = lane_mm

    def _state(self, state: StrokeState) -> Stroke | None:
        finished = None
        if not (state.contact and self._contact):
            self._before.clear()
        self._contact = state.contact
        if state.stroke and self.running is None:  # the last one's estimate may still be on its way
            self.running = self._begin(state.time_s)
            for frame in self._before:
                self.running.add(frame)
            self._before.clear()
        elif not state.stroke and self.running is not None:
            finished, self.waiting, self.running = self.waiting, self.running, None
        if (stroke := self.running) is not None:
            stroke.force_low |= state.force_low
            stroke.force_high |= state.force_high
            stroke.too_fast |= state.too_fast
        return finished
