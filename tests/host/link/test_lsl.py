"""The bridge to LabStreamingLayer, read by a real inlet."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace

import pylsl
import pytest

from palpate import models
from palpate.link import emulator_model as emulator
from palpate.link.flash import flash
from palpate.link.lsl import ESTIMATES, EVENTS, FRAMES, Outlets
from palpate.link.probe import Probe
from palpate.stroke.documents import Documents
from palpate.stroke.follower import Follower
from palpate.wire.events import Estimate, Frame
from tests.host.view import balls

PATIENCE_S = 60.0


def inlet(name: str, serial: str) -> pylsl.StreamInlet:
    (found,) = pylsl.resolve_bypred(f"name='{name}' and contains(source_id, '{serial}')", 1, PATIENCE_S)
    opened = pylsl.StreamInlet(found)
    opened.open_stream(PATIENCE_S)
    return opened


def estimate_of(events: pylsl.StreamInlet) -> dict:
    while True:
        (text,), _ = events.pull_sample(PATIENCE_S)
        if (told := json.loads(text))["event"] == "estimate":
            return told


@pytest.mark.timeout(300)
def test_frames_and_estimate_arrive_with_their_numbers_and_times(emulated, images):
    made = emulated("cpython")
    with Probe.open(made.port) as probe:
        flash(probe, images[0])
        probe.sync_clock()
        outlets = Outlets(probe)
        serial = probe.identity.serial
        frames, events = inlet(FRAMES, serial), inlet(EVENTS, serial)
        assert frames.info(PATIENCE_S).channel_count() == 2 + 416
        sent, said = [], None
        for event in probe.stream(strokes=1, timeout_s=PATIENCE_S):
            outlets.push(event)
            if isinstance(event, Frame):
                sent.append(event)
            elif isinstance(event, Estimate):
                said = event
        got = [frames.pull_sample(PATIENCE_S) for _ in sent]
        now = pylsl.local_clock()
        for frame, (values, at) in zip(sent, got, strict=True):
            assert values[0] == pytest.approx(frame.position_mm, abs=1e-3)
            assert values[2:] == pytest.approx(frame.pressure_kPa.ravel().tolist(), abs=1e-5)
            age_s = time.time() - frame.host_ns * 1e-9
            assert now - at == pytest.approx(age_s, abs=1.0)
        told = estimate_of(events)
        assert told["across"] is None and told["layer"] is None, "its model tells neither"
        assert said is not None and told["d_mm"]["value"] == pytest.approx(said.outputs["d_mm"]["value"])
        assert told["depth_mm"]["low"] <= told["depth_mm"]["value"] <= told["depth_mm"]["high"]


@pytest.mark.timeout(300)
def test_width_and_place_across_arrive_with_the_estimate_and_are_described(emulated):
    """LSL carried only what the probe itself had said."""
    streams = [balls.felt(balls.clear_beside(), 60)]
    given = {"public_key": emulator.public_key(), "model": emulator.image(models.BALLS)}
    made = emulated("cpython", strokes=streams, calibration=balls.calibration(), **given)
    with Probe.open(made.port) as probe:
        follower = Follower(Documents())
        follower.meet(probe)
        outlets = Outlets(probe)
        serial = probe.identity.serial
        estimates, events = inlet(ESTIMATES, serial), inlet(EVENTS, serial)
        for event in probe.stream(strokes=1, timeout_s=PATIENCE_S):
            follower.take(event)
            if isinstance(event, Estimate):
                said = event
                outlets.push(event, follower.of(event))
        outlets.push(replace(said, flags=0))
        labels = labels_of(estimates.info(PATIENCE_S))
        told = estimate_of(events)
        (row, _), (nothing, _) = estimates.pull_sample(PATIENCE_S), estimates.pull_sample(PATIENCE_S)
        numbers = dict(zip(labels, row, strict=True))
        for name, span in (("d_mm", told["d_mm"]), *list(told["across"].items())[1:]):
            assert [numbers[name + end, "mm"] for end in ("", "_low", "_high")] == list(span.values())
        assert 0 < numbers["width_mm_low", "mm"] < numbers["width_mm", "mm"]
        assert math.isnan(numbers["in_fat", ""]), "its model does not tell in which layer"
        assert all(map(math.isnan, nothing)), "no lump was found: the probe sends zeros"


def labels_of(info: pylsl.StreamInfo) -> list[tuple[str, str]]:
    channel, found = info.desc().child("channels").child("channel"), []
    while not channel.empty():
        found.append((channel.child_value("label"), channel.child_value("unit")))
        channel = channel.next_sibling()
    return found
