"""Events in, finished strokes out: the same for a live probe and for a recording read ahead."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from palpate.stroke.answered import Answered
from palpate.stroke.lanes import lane_of
from palpate.stroke.stroke import FollowedStroke
from palpate.wire.events import Event, Frame, Gap, Log, StrokeState, TactileMap

PRE_ROLL = 64
"""Frames kept between contact and start: the probe reports "started" some frames late."""

_SAME_S = 0.01
WARNING_S = 1.5
"""How long a warning (press harder, too fast) stays."""
_WARNINGS = {"force_low", "force_high", "too_fast"}


@dataclass(frozen=True)
class Phase:
    """The stroke at this moment; `time_s` is the probe's, of the last change."""

    time_s: float
    contact: bool = False
    stroke: bool = False
    lump: bool = False
    force_low: bool = False
    force_high: bool = False
    too_fast: bool = False


class _PhaseWatch:
    """Follows the changes that the probe tells; `now` is the phase."""

    def __init__(self) -> None:
        self.now = Phase(0.0)
        self._warned_s: float | None = None

    def change(self, event: StrokeState) -> None:
        """Take the next change."""
        time_s = event.time_us * 1e-6
        self.now = self._after(event.state, time_s)
        if event.state in _WARNINGS:
            self._warned_s = time_s

    def tick(self, time_s: float) -> None:
        """The probe's time goes on: a warning has been there long enough."""
        if self._warned_s is not None and not 0.0 <= time_s - self._warned_s <= WARNING_S:
            self._warned_s = None
            self.now = replace(self.now, time_s=time_s, force_low=False, force_high=False, too_fast=False)

    def reset(self) -> None:
        """The link broke: nothing is known of contact or stroke."""
        self.now = Phase(self.now.time_s)
        self._warned_s = None

    def _after(self, change: str, time_s: float) -> Phase:
        now = replace(self.now, time_s=time_s)
        if change in _WARNINGS:
            return replace(now, **{change: True})
        if change == "contact":
            return Phase(time_s, contact=True)
        if change == "started":
            return Phase(time_s, contact=True, stroke=True)
        if change == "lump_passed":
            return Phase(time_s, contact=True, stroke=True, lump=True)
        if change == "ended":
            return replace(now, stroke=False, lump=False)
        return Phase(time_s)


class Assembler:
    """Puts frames, states, map and answer of one stroke together.

    Parameters
    ----------
    new_stroke : callable
        Makes a stroke that starts at a device time, s.
    """

    def __init__(self, new_stroke: Callable[[float], FollowedStroke]) -> None:
        self._new_stroke = new_stroke
        self.running: FollowedStroke | None = None
        self.waiting: FollowedStroke | None = None
        """The stroke is over, its answer has not come."""
        self._begun: deque[FollowedStroke] = deque(maxlen=4)
        self._before: deque[Frame] = deque(maxlen=PRE_ROLL)
        self._watch = _PhaseWatch()

    @property
    def phase(self) -> Phase:
        """What the stroke is at."""
        return self._watch.now

    def feed(self, event: Event) -> FollowedStroke | None:
        """Take one event of `Answers`; returns the stroke that it finishes, if it finishes one."""
        if isinstance(event, Frame):
            self._watch.tick(event.time_us * 1e-6)
            if self.running is not None:
                self.running.add(event)
            elif self.phase.contact:
                self._before.append(event)
        elif isinstance(event, StrokeState):
            return self._change(event)
        elif isinstance(event, TactileMap):
            if event.usable and (stroke := self.waiting or self.running) is not None:
                stroke.map = event
        elif isinstance(event, Log):
            self._tell_lane(event.mark)
        elif isinstance(event, Answered):
            stroke = self.waiting or self.running or self._begin(event.estimate.time_us * 1e-6)
            stroke.estimate, stroke.told = event.estimate, event.told
            if stroke is self.running:
                self.running = None
            self.waiting = None
            return stroke
        elif isinstance(event, Gap):
            return self.give_up()
        return None

    def give_up(self) -> FollowedStroke | None:
        """The link broke, or the file ended: no more of this stroke will come; returns one that was over."""
        stroke, self.waiting, self.running = self.waiting, None, None
        self._watch.reset()
        self._before.clear()
        return stroke

    def _begin(self, started_s: float) -> FollowedStroke:
        stroke = self._new_stroke(started_s)
        self._begun.append(stroke)
        return stroke

    def _tell_lane(self, mark: str | None) -> None:
        """Where a recorded mark tells a stroke's lane: of a busy machine it may stand behind its end."""
        if mark is None or (told := lane_of(mark)) is None:
            return
        lane_mm, started_s = told
        for stroke in self._begun:
            if abs(stroke.started_s - started_s) < _SAME_S:
                stroke.lane_mm = lane_mm

    def _change(self, event: StrokeState) -> FollowedStroke | None:
        finished = None
        touched = self.phase.contact
        self._watch.change(event)
        now = self.phase
        if not (now.contact and touched):
            self._before.clear()
        if now.stroke and self.running is None:  # the last one's answer may still be on its way
            self.running = self._begin(now.time_s)
            for frame in self._before:
                self.running.add(frame)
            self._before.clear()
        elif not now.stroke and self.running is not None:
            finished, self.waiting, self.running = self.waiting, self.running, None
        if (stroke := self.running) is not None:
            stroke.force_low |= now.force_low
            stroke.force_high |= now.force_high
            stroke.too_fast |= now.too_fast
        return finished
