"""A probe's stream on LabStreamingLayer, beside EEG, eye trackers and whatever else a laboratory records.

Three outlets: `PalpateFrames` (place, displacement and every cell's pressure, stamped with the moment of the
scan), `PalpateEstimates` (each stroke's numbers, a channel each, NaN where the model does not tell one) and
`PalpateEvents` (stroke states and estimates as JSON, of LSL's type Markers, with the fields of
`palpate stream --json`).
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from firmware_py import geometry, outputs, tables
from palpate.answer import answer_dict
from palpate.errors import MissingExtra
from palpate.link.probe import Probe
from palpate.model_export.vocabulary import SHOWN_UNITS
from palpate.wire.events import Estimate, Event, Frame, StrokeState

if TYPE_CHECKING:
    from palpate.answer.told import Told

FRAMES, ESTIMATES, EVENTS = "PalpateFrames", "PalpateEstimates", "PalpateEvents"
MOTION = (("position", "mm"), ("displacement", "mm"), *((name, "") for name in tables.FRAME_MORE))
NUMBERS = (*SHOWN_UNITS.items(), ("depth_mm", "mm"), ("width_mm", "mm"), ("place_mm", "mm"), ("in_fat", ""))
"""Of an estimate, with units: the probe's outputs, then what the host works out; each has three channels."""


class Outlets:
    """What a probe sends, for everyone on the laboratory's network.

    Parameters
    ----------
    probe : Probe
        Live; its serial number and model go into the streams' descriptions.

    Raises
    ------
    MissingExtra
        pylsl is not installed.
    """

    def __init__(self, probe: Probe) -> None:
        try:
            import pylsl
        except (ImportError, RuntimeError) as error:  # RuntimeError: without the library it wraps
            raise MissingExtra("pylsl", "lsl", "LabStreamingLayer") from error
        self._probe = probe
        self._lsl = pylsl
        cells = [
            (f"cell {row},{column}", "kPa")
            for row in range(geometry.ROWS)
            for column in range(geometry.COLUMNS)
        ]
        numbers = [(f"{name}{end}", unit) for name, unit in NUMBERS for end in ("", "_low", "_high")]
        self._frames = self._outlet(FRAMES, "Pressure", pylsl.cf_float32, (*MOTION, *cells))
        self._estimates = self._outlet(ESTIMATES, "Estimate", pylsl.cf_double64, numbers)
        self._events = self._outlet(EVENTS, "Markers", pylsl.cf_string, [("event", "JSON")])

    def _outlet(self, name: str, kind: str, form: int, channels: Sequence[tuple[str, str]]) -> Any:
        """An outlet whose description tells label and unit of every channel."""
        lsl, who = self._lsl, self._probe.identity
        ending = name.removeprefix("Palpate").lower()
        source = f"palpate-{who.serial}-{ending}"
        info = lsl.StreamInfo(name, kind, len(channels), lsl.IRREGULAR_RATE, form, source)
        listed = info.desc().append_child("channels")
        for label, unit in channels:
            channel = listed.append_child("channel")
            channel.append_child_value("label", label)
            channel.append_child_value("unit", unit)
        info.desc().append_child_value("serial", who.serial)
        info.desc().append_child_value("model_id", who.model_id)
        return lsl.StreamOutlet(info)

    def push(self, event: Event, told: Told | None = None) -> None:
        """Hand one event on; those that are neither frame, stroke state nor estimate are left out.

        told: what the host adds to an estimate (`palpate.stroke.follower`).
        """
        if isinstance(event, Frame):
            motion = event.position_mm, event.displacement_mm, *event.more
            sample = [*map(float, motion), *map(float, event.pressure_kPa.ravel())]
            self._frames.push_sample(sample, self._when(event))
        elif isinstance(event, Estimate):
            said = answer_dict(event, told)
            self._estimates.push_sample(_numbers(event, said), self._when(event))
            self._tell({"event": "estimate", **said}, event)
        elif isinstance(event, StrokeState):
            self._tell({"event": event.state, "stroke": event.stroke}, event)

    def _tell(self, words: dict[str, Any], event: Event) -> None:
        self._events.push_sample([json.dumps(words)], self._when(event))

    def _when(self, event: Any) -> float:
        """The moment on LSL's clock, s: of the scan, where the clocks have been compared; else of its
        arrival."""
        host_us = self._probe.host_time_us(event.time_us)
        unix_s = event.host_ns * 1e-9 if host_us is None else host_us * 1e-6
        return float(self._lsl.local_clock() - (time.time() - unix_s))


def _numbers(event: Estimate, said: dict[str, Any]) -> list[float]:
    """The channels of `NUMBERS`; all NaN where there is no lump, for which a probe sends zeros."""
    told = {**said, **(said["across"] or {}), **(said["layer"] or {})} if event.valid and event.lump else {}
    return [(told.get(name) or {}).get(part, math.nan) for name, _ in NUMBERS for part in outputs.PARTS]
