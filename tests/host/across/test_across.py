"""Width and place across the stroke: what the host adds to a probe's answer, live and from a recording."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from palpate import models
from palpate.link import emulator_model as emulator
from palpate.recording.channels import MODEL
from palpate.recording.playback import open_recording
from palpate.recording.reader import Recording
from palpate.sim.probe.emulated import EmulatedProbe
from palpate.stroke.documents import Documents
from palpate.stroke.read import follower_of, load_strokes
from palpate.wire.events import Estimate, Features, Frame, Gap
from tests.host.conftest import emulated
from tests.host.link.test_streams import leave_a_stroke_behind
from tests.host.processes import start_palpate
from tests.host.view import balls
from tests.waiting import PATIENCE_S

__all__ = ["emulated"]

FRAMES = 60


def streamed(palpate, emulated, tmp_path, streams, calibration, name=models.BALLS, *more):
    """The estimates of a live probe with this model, each stroked over once, and the recording."""
    given = {"public_key": emulator.public_key(), "model": emulator.image(name)}
    probe = emulated(strokes=streams, calibration=calibration, **given)
    visit = tmp_path / "visit.mcap"
    status, out, err = palpate(
        "stream", "--port", probe.port, "--strokes", len(streams), "--record", visit, "--json", *more
    )
    assert status == 0, err
    return json.loads(out)["strokes"], visit


@pytest.fixture(scope="module")
def beside():
    """A lump beside the line, and the same on the other side."""
    lump = balls.clear_beside()
    return lump, [balls.felt(lump, FRAMES), balls.felt(lump, FRAMES, turned=True)], balls.calibration()


@pytest.fixture(scope="module")
def visit(beside, tmp_path_factory):
    """The same as estimates of a live probe, and its recording."""
    file = tmp_path_factory.mktemp("visit") / "visit.mcap"
    given = {"public_key": emulator.public_key(), "model": emulator.image(models.BALLS), "roomy": True}
    with EmulatedProbe("cpython", beside[1], calibration=beside[2], **given) as probe:
        words = ("--port", probe.port, "--strokes", 2, "--record", file, "--json")
        with start_palpate("stream", *words) as run:
            out, err = run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 0, err
    return json.loads(out)["strokes"], file


def holds(interval, true):
    return (
        interval["low"] <= true <= interval["high"] and interval["low"] < interval["value"] < interval["high"]
    )


def test_a_lump_beside_the_line_is_told_on_its_side_live_and_replayed(palpate, visit, beside):
    case = beside[0].case
    strokes, file = visit
    for stroke, side in zip(strokes, (1, -1), strict=True):
        assert holds(stroke["across"]["place_mm"], side * case.offset_mm)
        assert holds(stroke["across"]["width_mm"], 2 * case.half_axes_mm[1])
        assert (
            side * stroke["across"]["place_mm"]["low"] > 0 and side * stroke["across"]["place_mm"]["high"] > 0
        )
    status, out, _ = palpate("replay", file, "--json")
    assert status == 0
    assert [s["across"] for s in json.loads(out)["strokes"]] == [s["across"] for s in strokes]
    status, out, _ = palpate("replay", file)
    assert status == 0
    assert out.count("place across") == 2, "each stroke has a line of its own: places are not pooled"
    assert out.count("width across") == 3 and "90 % interval" in out


def test_of_a_stroke_that_an_earlier_client_left_behind_the_width_is_told(palpate, emulated, visit, beside):
    """The probe keeps features, and no frames: a place cannot be told."""
    given = {"public_key": emulator.public_key(), "model": emulator.image(models.BALLS)}
    probe = emulated(strokes=beside[1], calibration=beside[2], **given)
    left_behind = leave_a_stroke_behind(probe)
    status, out, _ = palpate("stream", "--port", probe.port, "--strokes", 1, "--earlier", "--json")
    (left,) = json.loads(out)["earlier"]
    assert status == 0 and left["stream"] == left_behind
    assert left["across"] == {**visit[0][0]["across"], "place_mm": None}


def test_a_model_that_does_not_tell_them_says_neither(palpate, emulated, tmp_path, beside):
    strokes, file = streamed(palpate, emulated, tmp_path, *beside[1:], models.FIELD)
    assert [stroke["across"] for stroke in strokes] == [None, None]
    status, out, _ = palpate("replay", file)
    assert status == 0 and "across" not in out


def events_of(file):
    with open_recording(file) as session:
        return list(session.events())


def told(file, events):
    follower = follower_of(Recording(file))
    said = []
    for event in events:
        follower.take(event)
        if isinstance(event, Estimate):
            said.append(follower.of(event).across)
    return said


def test_where_frames_are_missing_the_width_is_told_and_no_place(visit):
    strokes, file = visit
    events = events_of(file)
    last = next(e.last_seq for e in events if isinstance(e, Estimate))
    first, second = told(file, [e for e in events if not (isinstance(e, Frame) and e.seq == last - 20)])
    assert first.place_mm is None
    assert first.width_mm == tuple(strokes[0]["across"]["width_mm"].values())
    assert second.as_dict() == strokes[1]["across"]


def test_features_that_did_not_come_are_worked_out_from_the_frames(visit):
    strokes, file = visit
    without = [e for e in events_of(file) if not isinstance(e, Features)]
    assert [one.as_dict() for one in told(file, without)] == [stroke["across"] for stroke in strokes]


def test_after_the_probe_was_reset_frames_of_before_are_no_stroke_of_its(visit):
    _, file = visit
    events = events_of(file)
    at = next(k for k, e in enumerate(events) if isinstance(e, Estimate))
    reset = Gap(events[at].host_ns, 1.0, "it was unplugged", restarted=True)
    assert told(file, [*events[:at], reset, *events[at:]])[0].place_mm is None


def test_only_strokes_that_show_a_lump_are_told_of(visit):
    _, file = visit
    follower = follower_of(Recording(file))
    for event in events_of(file):
        follower.take(event)
        if isinstance(event, Estimate):
            assert follower.of(event) is not None
            assert follower.of(replace(event, flags=0)) is None


def test_a_document_of_the_user_s_own_is_taken_where_it_belongs_and_nowhere_else(
    palpate, visit, tmp_path, monkeypatch
):
    strokes, file = visit
    image = Recording(file).attachment(MODEL)
    wider = models.load(models.BALLS)
    wider = replace(wider, across=replace(wider.across, place_stretch=2 * wider.across.place_stretch))
    wider.save(tmp_path / "own.json")
    status, out, err = palpate("replay", file, "--document", tmp_path / "own.json", "--json")
    assert status == 0 and not err
    for ours, plain in zip(json.loads(out)["strokes"], strokes, strict=True):
        wanted = 2 * plain["across"]["place_mm"]["value"]
        assert ours["across"]["place_mm"]["value"] == pytest.approx(wanted)
    status, out, err = palpate("replay", file, "--document", models.FIELD, "--json")
    assert status == 0 and err == (
        "field is not of the model that answers, and is not used: its own, which comes with Palpate, is used "
        "instead\n"
    )
    assert [s["across"] for s in json.loads(out)["strokes"]] == [s["across"] for s in strokes]
    with monkeypatch.context() as m:
        looked_up = []
        m.setattr(models, "trained_on", lambda hash_: looked_up.append(hash_))
        palpate("replay", file)
        assert len(looked_up) == 1, "it was looked up twice"
    unknown = Documents()
    unknown.learn(image[:48] + bytes(32) + image[80:])
    assert unknown.of(image[40:48]) is None


def test_the_viewer_s_strokes_tell_them_on_card_and_outline(visit, beside):
    strokes, file = visit
    for shown, said in zip(load_strokes(file), strokes, strict=True):
        rows = {row["key"]: row for row in shown.summary()["card"]["rows"]}
        lump = shown.lump().as_dict()
        for key, name in (("width_mm", "width_mm"), ("place_mm", "across_mm")):
            span = list(said["across"][key].values())
            assert [rows[key][part] for part in ("value", "low", "high")] == span
            assert lump[name] == pytest.approx(span, abs=1e-3)
