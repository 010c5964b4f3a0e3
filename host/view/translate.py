"""The link's events as the viewer's: the wire's integers become mm, kPa and lasting states.

The probe tells *changes* (contact, started, lump passed, ended); the page shows what *is*.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from firmware_py import outputs, status
from palpate.across.follower import Follower
from palpate.link import events as link
from palpate.link.answer import Span
from palpate.link.scale import CellScale
from palpate.recording.channels import MARK_PREFIX
from palpate.view.events import KNOWN, Estimate, Event, Frame, Interval, MapFit, Mark, ProbeMap, StrokeState

if TYPE_CHECKING:
    from palpate.across.told import Told

WARNING_S = 1.5
"""How long a warning (press harder, too fast) stays on the page."""
MAP_PATIENCE_US = 2_000_000
"""How long an estimate that has come waits for its map, which comes behind it, in the probe's time."""
_WARNINGS = {"force_low", "force_high", "too_fast"}


class Translator:
    """Link events in, viewer events out; keeps the state of the stroke.

    With a follower, which gets every event, estimates tell what the host adds (`palpate.across`).
    """

    def __init__(self, scale: CellScale, follower: Follower | None = None) -> None:
        self.scale = scale
        self.follower = follower
        self._state = StrokeState(0.0)
        self._warned_s: float | None = None
        self._map_of = (0, 0)
        self._held: link.Estimate | None = None
        self._held_from_us: int | None = None  # first frame since; a slow probe answers long after its stroke

    def feed(self, event: link.Event) -> Iterator[Event]:
        """What one event of the link means for the page."""
        if self.follower is not None:
            self.follower.take(event)
        if isinstance(event, link.Frame):
            yield from self._expire(event.time_us * 1e-6)
            if self._held is not None:
                if self._held_from_us is None:
                    self._held_from_us = event.time_us
                if event.time_us - self._held_from_us > MAP_PATIENCE_US:
                    yield from self.finish()
            yield self.frame(event)
        elif isinstance(event, link.StrokeState):
            if event.state == "started":
                yield from self.finish()
            self._state = self._step(event.state, event.time_us * 1e-6)
            yield self._state
        elif isinstance(event, link.TactileMap):
            self._map_of = event.stream, event.stroke
            if (found := probe_map(event)) is not None:
                yield found
            if self._held is not None and (self._held.stream, self._held.stroke) == self._map_of:
                yield from self.finish()
        elif isinstance(event, link.Estimate):
            yield from self.finish()
            self._held, self._held_from_us = event, None
            if (event.stream, event.stroke) == self._map_of:
                yield from self.finish()
        elif isinstance(event, link.Log) and event.text.startswith(MARK_PREFIX):
            yield Mark(event.time_us * 1e-6, event.text.removeprefix(MARK_PREFIX))

    def frame(self, event: link.Frame) -> Frame:
        """A frame with its pressures."""
        return Frame(
            seq=event.seq,
            time_s=event.time_us * 1e-6,
            host_time_s=event.host_ns * 1e-9,
            position_mm=event.position_mm,
            displacement_mm=event.displacement_mm,
            pressure_kPa=self.scale.kPa(event.counts),
        )

    def finish(self) -> Iterator[Event]:
        """Hand on the estimate that waits for its map: it has come, or will not."""
        if self._held is not None:
            held, self._held = self._held, None
            yield estimate(held, None if self.follower is None else self.follower.of(held))

    def reset(self) -> None:
        """The link broke: nothing is known of contact or stroke."""
        self._state = StrokeState(self._state.time_s)
        self._warned_s = None
        self._held = None

    def _step(self, change: str, time_s: float) -> StrokeState:
        state = replace(self._state, time_s=time_s)
        if change in _WARNINGS:
            self._warned_s = time_s
            return replace(state, **{change: True})
        if change == "contact":
            return StrokeState(time_s, contact=True)
        if change == "started":
            return StrokeState(time_s, contact=True, stroke=True)
        if change == "lump_passed":
            return StrokeState(time_s, contact=True, stroke=True, lump=True)
        if change == "ended":
            return replace(state, stroke=False, lump=False)
        return StrokeState(time_s)

    def _expire(self, time_s: float) -> Iterator[StrokeState]:
        if self._warned_s is not None and not 0.0 <= time_s - self._warned_s <= WARNING_S:
            self._warned_s = None
            self._state = replace(
                self._state, time_s=time_s, force_low=False, force_high=False, too_fast=False
            )
            yield self._state


def probe_map(event: link.TactileMap) -> ProbeMap | None:
    """The probe's map in mm and kPa; None where it has none (a stroke too short for a map)."""
    if not event.values or event.status not in (status.OK, status.NO_FIT):
        return None
    told = event.as_dict()
    fit = None
    if event.status == status.OK and event.stdev_q16 > 0:
        fit = MapFit(
            base_kPa=told["base_kPa"],
            amp_kPa=told["amplitude_kPa"],
            centre_mm=told["centre_mm"],
            stdev_mm=told["stdev_mm"],
        )
    columns = event.first_column, event.end_column
    return ProbeMap(tuple(told["x_mm"]), tuple(told["pressure_kPa"]), fit, columns)


def _interval(span: Span | None) -> Interval | None:
    return None if span is None else Interval(*span)


def estimate(event: link.Estimate, told: Told | None = None) -> Estimate:
    """The probe's answer with its numbers as intervals, and what the host adds."""
    across = None if told is None else told.across
    said = {name: Interval(**parts) for name, parts in event.outputs.items()}
    known = {name: said.pop(name) for name in KNOWN & said.keys()}
    return Estimate(
        time_s=event.time_us * 1e-6,
        **known,
        further=said,
        width_mm=_interval(None if across is None else across.width_mm),
        place_mm=_interval(None if across is None else across.place_mm),
        layer=None if told is None else told.layer,
        outside=() if told is None else told.outside,
        lump=event.lump,
        hardness=event.hardness,
        in_domain=event.in_domain,
        force_out=bool(event.flags & outputs.FORCE_OUT),
        invalid=not event.valid and event.status not in (status.NO_LUMP, status.NO_FIT, status.FORCE_RANGE),
        no_model=event.status == status.NO_MODEL,
        uncalibrated=not event.calibrated,
        reference=event.reference,
        level=event.level_permille / 1000,
        model_id=event.model_id.hex() if any(event.model_id) else "",
        status_text="" if event.status == status.OK else event.reason,
    )
