"""A probe's stream on LabStreamingLayer, beside EEG, eye trackers and whatever else a laboratory records.

Two outlets: `PalpateFrames` (place, displacement and every cell's pressure, stamped with the moment of the
scan) and `PalpateEvents` (stroke states and estimates as JSON, of LSL's type Markers). An estimate has the
fields of `palpate stream --json`; `ADDED` are those that the host adds, null where the model does not tell
them.
"""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

from firmware_py import geometry
from palpate.across import answer_dict
from palpate.errors import MissingExtra
from palpate.link.events import Estimate, Event, Frame, StrokeState
from palpate.link.probe import Probe

if TYPE_CHECKING:
    from palpate.across.told import Told

FRAMES, EVENTS = "PalpateFrames", "PalpateEvents"
MOTION = (("position", "mm"), ("displacement", "mm"))
ADDED = (
    ("across.width_mm", "mm", "width across the stroke: value, low, high"),
    ("across.place_mm", "mm", "of the lump's middle from the face's, across the stroke: value, low, high"),
    ("layer.place", "", "in the fat, at the border, in the gland, unsure"),
    ("layer.in_fat", "", "share of the lump's height that lies in the fat: value, low, high"),
    ("layer.size", "", "which diameter goes with which stiffness"),
    ("outside", "", "why the model is not for the stroke"),
)
"""Field of an estimate's JSON, unit, what it is; in the stream's description, too."""


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
        self._clock = pylsl.local_clock
        serial = probe.identity.serial
        channels = len(MOTION) + geometry.CELLS
        frames = pylsl.StreamInfo(
            FRAMES, "Pressure", channels, pylsl.IRREGULAR_RATE, pylsl.cf_float32, f"palpate-{serial}-frames"
        )
        listed = frames.desc().append_child("channels")
        cells = [
            (f"cell {row},{column}", "kPa")
            for row in range(geometry.ROWS)
            for column in range(geometry.COLUMNS)
        ]
        for label, unit in (*MOTION, *cells):
            channel = listed.append_child("channel")
            channel.append_child_value("label", label)
            channel.append_child_value("unit", unit)
        events = pylsl.StreamInfo(
            EVENTS, "Markers", 1, pylsl.IRREGULAR_RATE, pylsl.cf_string, f"palpate-{serial}-events"
        )
        fields = events.desc().append_child("added_by_host")
        for name, unit, meaning in ADDED:
            field = fields.append_child("field")
            for key, text in (("name", name), ("unit", unit), ("meaning", meaning)):
                field.append_child_value(key, text)
        for info in (frames, events):
            info.desc().append_child_value("serial", serial)
            info.desc().append_child_value("model_id", probe.identity.model_id)
        self._frames, self._events = pylsl.StreamOutlet(frames), pylsl.StreamOutlet(events)

    def push(self, event: Event, told: Told | None = None) -> None:
        """Hand one event on; those that are neither frame, stroke state nor estimate are left out.

        told: what the host adds to an estimate (`palpate.across.follower`).
        """
        if isinstance(event, Frame):
            sample = [event.position_mm, event.displacement_mm, *map(float, event.pressure_kPa.ravel())]
            self._frames.push_sample(sample, self._when(event))
        elif isinstance(event, Estimate):
            self._tell({"event": "estimate", **answer_dict(event, told)}, event)
        elif isinstance(event, StrokeState):
            self._tell({"event": event.state, "stroke": event.stroke}, event)

    def _tell(self, words: dict[str, Any], event: Event) -> None:
        self._events.push_sample([json.dumps(words)], self._when(event))

    def _when(self, event: Any) -> float:
        """The moment on LSL's clock, s: of the scan, where the clocks have been compared; else of its
        arrival."""
        host_us = self._probe.host_time_us(event.time_us)
        unix_s = event.host_ns * 1e-9 if host_us is None else host_us * 1e-6
        return float(self._clock() - (time.time() - unix_s))
