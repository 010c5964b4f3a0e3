"""The bridge to LabStreamingLayer, read by a real inlet."""

from __future__ import annotations

import json
import time

import pylsl
import pytest

from palpate.link.events import Estimate, Frame
from palpate.link.flash import flash
from palpate.link.lsl import EVENTS, FRAMES, Outlets
from palpate.link.probe import Probe

PATIENCE_S = 60.0


def inlet(name: str, serial: str) -> pylsl.StreamInlet:
    (found,) = pylsl.resolve_bypred(f"name='{name}' and contains(source_id, '{serial}')", 1, PATIENCE_S)
    opened = pylsl.StreamInlet(found)
    opened.open_stream(PATIENCE_S)
    return opened


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
        told = None
        while told is None or told["event"] != "estimate":
            (text,), _ = events.pull_sample(PATIENCE_S)
            told = json.loads(text)
        assert said is not None and told["d_mm"]["value"] == pytest.approx(said.outputs["d_mm"]["value"])
        assert told["depth_mm"]["low"] <= told["depth_mm"]["value"] <= told["depth_mm"]["high"]
