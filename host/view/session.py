"""Everything since the viewer was started, and what each page is told of it.

The source's thread brings events in (`on_event`); pages read snapshots and mailboxes from the server's
thread.
"""

from __future__ import annotations

import struct
import threading
import time
import uuid
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from palpate.stroke.answered import Answered
from palpate.stroke.assemble import Assembler, Phase
from palpate.stroke.lanes import lane_of
from palpate.stroke.stroke import FollowedStroke
from palpate.stroke.tactile_map import force_N_per_m, peak_kPa
from palpate.view.mailbox import FRAME, Mailbox, Message
from palpate.view.notices import (
    Health,
    Jumped,
    LinkChanged,
    LinkState,
    Notice,
    OtherEnd,
    Playback,
    RecordingStopped,
    Refined,
)
from palpate.view.visits import MAX_STROKES, Visits
from palpate.wire.events import Event, Frame, Gap, Log, StrokeState, TactileMap

PROGRESS_INTERVAL_S = 0.1
_FRAME_HEAD = struct.Struct("<BBHIddffff")


def pack_frame(frame: Frame) -> bytes:
    """A frame for the page: head (see `_FRAME_HEAD`), then a float32 a cell, kPa, all little-endian."""
    pressure_kPa = frame.pressure_kPa
    head = _FRAME_HEAD.pack(
        1,
        0,
        0,
        frame.seq & 0xFFFFFFFF,
        frame.time_us * 1e-6,
        frame.host_ns * 1e-9,
        frame.position_mm,
        frame.displacement_mm,
        force_N_per_m(pressure_kPa),
        peak_kPa(pressure_kPa),
    )
    return head + np.ascontiguousarray(pressure_kPa, dtype="<f4").tobytes()


class Session:
    """State and history, told to every page.

    Parameters
    ----------
    mode : "live" or "replay"
    name : what the page calls the source
    fat_kPa : the fat's modulus, where it is known
    """

    def __init__(self, *, mode: str, name: str, fat_kPa: float | None = None) -> None:
        self.mode = mode
        self.name = name
        self.id = uuid.uuid4().hex
        """A page that finds another one behind the same address forgets what it knew."""
        self.visits = Visits("This visit" if mode == "live" else name, fat_kPa)
        self.lock = threading.RLock()
        self.link = LinkChanged(LinkState.CONNECTING, "Looking for the probe.")
        self.device: OtherEnd | None = None
        self.health = Health()
        self.phase = Phase(0.0)
        """As the pages know it."""
        self.playback: Playback | None = None
        self.recording: dict[str, Any] | None = None
        self.on_lane: Callable[[float, float], None] | None = None
        """Called with lane, mm, and start, s, of each stroke that begins where the operator says it."""
        self._mailboxes: set[Mailbox] = set()
        self._assembler = Assembler(self._new_stroke)
        self._progress_at = 0.0
        self._refined: dict[int, dict[str, Any]] = {}

    # ---- pages

    def join(self) -> Mailbox:
        """A mailbox for a page that has just opened."""
        mailbox = Mailbox()
        with self.lock:
            self._mailboxes.add(mailbox)
        return mailbox

    def leave(self, mailbox: Mailbox) -> None:
        """The page is gone."""
        with self.lock:
            self._mailboxes.discard(mailbox)

    def snapshot(self) -> dict[str, Any]:
        """All that a page must know to start."""
        with self.lock:
            return {
                "type": "hello",
                "session": self.id,
                "mode": self.mode,
                "name": self.name,
                "link": self._link_json(),
                "health": asdict(self.health),
                "state": asdict(self.phase),
                "recording": self.recording,
                "playback": None if self.playback is None else asdict(self.playback),
                "running": None if (going := self._going()) is None else going.progress(),
                **self.visits.snapshot(),
            }

    def _going(self) -> FollowedStroke | None:
        """The stroke that runs, or waits for its answer."""
        return self._assembler.running or self._assembler.waiting

    def tell(self, message: dict[str, Any]) -> None:
        """Tell every page something that it must not miss."""
        with self.lock:
            for mailbox in self._mailboxes:
                mailbox.put_event(message)

    def tell_slot(self, message: Message) -> None:
        """Tell every page the newest of its kind."""
        name = FRAME if isinstance(message, bytes) else message["type"]
        with self.lock:
            for mailbox in self._mailboxes:
                mailbox.put_slot(name, message)

    def tell_visits(self) -> None:
        """Tell every page of the visits and their strokes."""
        self.tell_slot({"type": "visits", **self.visits.snapshot()})

    def _tell_lanes(self) -> dict[str, Any]:
        lanes = self.visits.lanes.as_dict()
        self.tell_slot({"type": "lanes", "lanes": lanes})
        return lanes

    def set_recording(self, recording: dict[str, Any] | None) -> None:
        """What is being written, or None."""
        with self.lock:  # reported in the order in which it happened, whichever thread reports it
            self.recording = recording
            self.tell({"type": "recording", "recording": recording})

    def _new_stroke(self, started_s: float) -> FollowedStroke:
        if self.mode == "replay" and (known := self.visits.at(started_s)) is not None:
            return FollowedStroke(number=known.number, visit=known.visit, started_s=started_s)
        stroke = self.visits.new_stroke(started_s)
        self._tell_lanes()
        if stroke.lane_mm is not None and self.on_lane is not None:
            self.on_lane(stroke.lane_mm, stroke.started_s)
        return stroke

    def set_lanes(self, told: bool, next_mm: float, step_mm: float) -> dict[str, Any]:
        """Where the strokes to come lie across the tissue; the lanes for the page."""
        with self.lock:
            self.visits.lanes.set(told, next_mm, step_mm)
            return self._tell_lanes()

    def _give_up(self) -> FollowedStroke | None:
        """No more of the running stroke will come; returns one that was over."""
        if self._assembler.running is not None:
            self.visits.lanes.again()
            self._tell_lanes()
        return self._assembler.give_up()

    # ---- events from the source

    def on_event(self, event: Event | Notice | FollowedStroke) -> None:
        """Take one event, or a stroke that a source has read ahead; called in the source's thread."""
        with self.lock:
            match event:
                case Frame():
                    self._on_frame(event)
                case StrokeState():
                    self._on_state(event)
                case TactileMap() | Answered():
                    if (finished := self._assembler.feed(event)) is not None:
                        self._finish(finished)
                case Gap():
                    self._interrupted()
                case Log():
                    self._assembler.feed(event)
                    if (text := event.mark) is not None and lane_of(text) is None:
                        self.tell({"type": "mark", "time_s": event.time_us * 1e-6, "text": text})
                case FollowedStroke():
                    self._read_ahead(event)
                case Health():
                    self.health = event
                    self.tell_slot({"type": "health", "health": asdict(event)})
                case LinkChanged():
                    self._on_link(event)
                case RecordingStopped():
                    self.set_recording(None)
                    self.tell({"type": "notice", "text": event.text})
                case Playback():
                    self.playback = event
                    self.tell_slot({"type": "playback", "playback": asdict(event)})
                case Jumped():
                    self._forget_running()
                case Refined():
                    self._on_refined(event)

    def _forget_running(self) -> None:
        """A half-seen stroke will not go on: somebody moved along the recording."""
        self._give_up()
        self._tell_phase()
        self.tell_slot({"type": "progress", "number": None})

    def _interrupted(self) -> None:
        """The link broke: what was under way will not be finished."""
        if (given_up := self._give_up()) is not None:
            self._finish(given_up)
        self._tell_phase()

    def _on_frame(self, frame: Frame) -> None:
        self._assembler.feed(frame)
        self._tell_phase()
        if not self._mailboxes:
            return
        self.tell_slot(pack_frame(frame))
        now = time.monotonic()
        if self._assembler.running is not None and now - self._progress_at >= PROGRESS_INTERVAL_S:
            self._tell_progress(self._assembler.running)

    def _on_state(self, state: StrokeState) -> None:
        if (finished := self._assembler.feed(state)) is not None:
            self._finish(finished)
        if not self._assembler.phase.stroke and self.phase.stroke and self._assembler.waiting is not None:
            self._tell_progress(self._assembler.waiting)
        self._tell_phase()

    def _tell_phase(self) -> None:
        if (phase := self._assembler.phase) != self.phase:
            self.phase = phase
            self.tell_slot({"type": "state", "state": asdict(phase)})

    def _tell_progress(self, stroke: FollowedStroke) -> None:
        if self._mailboxes:
            self.tell_slot(stroke.progress())
        self._progress_at = time.monotonic()

    def _finish(self, stroke: FollowedStroke) -> None:
        """A stroke is over: live, it goes into the history; replayed, it is there already."""
        self._refine(stroke)
        if self.mode == "replay":
            known = self.visits.same(stroke)
            stroke = stroke if known is None else known
        else:
            self.visits.add(stroke)
            if (running := self._assembler.running) is not None:
                running.number = stroke.number + 1
            self.tell_visits()
        self.tell({**stroke.detail(images=False), "fresh": True})

    def _on_refined(self, refined: Refined) -> None:
        self._refined[refined.estimate_us] = refined.card
        if len(self._refined) > MAX_STROKES:
            del self._refined[next(iter(self._refined))]
        for stroke in self.visits.strokes():
            if self._refine(stroke) is refined.card:
                self.tell({"type": "refined", "number": stroke.number, "refined": refined.card})

    def _refine(self, stroke: FollowedStroke) -> dict[str, Any] | None:
        """Put what the forward model has said of a stroke to it."""
        if stroke.estimate is not None:
            stroke.refined = self._refined.get(stroke.estimate.time_us)
        return stroke.refined

    def _read_ahead(self, stroke: FollowedStroke) -> None:
        self._refine(stroke)
        self.visits.adopt(stroke)
        self.tell_visits()

    def _on_link(self, link: LinkChanged) -> None:
        self.link = link
        self.device = link.device or self.device
        if link.state is not LinkState.CONNECTED:
            self._interrupted()
        self.tell({"type": "link", "link": self._link_json()})

    def _link_json(self) -> dict[str, Any]:
        return {
            "state": self.link.state.value,
            "text": self.link.text,
            "device": None if self.device is None else asdict(self.device),
        }
