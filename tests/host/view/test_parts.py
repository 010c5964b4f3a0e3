"""Strokes and their cards, without a browser."""

from __future__ import annotations

import dataclasses
import json
import math
import resource

import numpy as np
import pytest
from matplotlib.figure import Figure

from firmware_py import status
from palpate.answer.card import card
from palpate.stroke.assemble import Assembler
from palpate.stroke.stroke import MAX_FRAMES, MAX_IMAGES, FollowedStroke
from palpate.view.exports import stroke_figure
from palpate.view.lump_outline import draw_outline
from palpate.view.notices import LinkChanged, LinkState
from palpate.view.page_connection import to_json
from palpate.view.session import Session
from palpate.wire.events import Frame
from tests.host.view.synthetic import Bump, estimate, frame, state, stroke


def test_frames_before_the_probe_says_started_belong_to_the_stroke_and_those_in_the_air_do_not():
    assembler = Assembler(lambda t: FollowedStroke(number=1, visit=1, started_s=t))

    def felt(numbers):
        for n in numbers:
            assembler.feed(frame(n, n * 0.01, float(n), 1.0, np.ones((16, 26))))

    felt(range(5))
    assembler.feed(state(0.05, "contact"))
    felt(range(5, 9))
    assembler.feed(state(0.09, "started"))
    felt(range(9, 20))
    assembler.feed(state(0.2, "lifted"))
    assert assembler.running is None
    done = assembler.feed(estimate(Bump(), 0.21))
    assert done is not None and done.position_mm == [float(n) for n in range(5, 20)]
    assert done.started_s == pytest.approx(0.09) and done.gaps == 0


def test_a_lost_estimate_does_not_go_to_the_next_stroke():
    session = Session(mode="live", name="x")
    for second, change in enumerate(("started", "ended", "started", "lifted")):
        session.on_event(state(second, change))
    session.on_event(estimate(Bump(d_mm=7.0), 3.1))
    first, second = session.visits.strokes()
    assert first.estimate is None and first.summary()["card"]["title"] == "No answer from the probe"
    assert second.value("d_mm") == 7.0


def test_a_late_estimate_goes_to_its_own_stroke_though_the_next_has_begun():
    """It was "No answer" for the one, and the answer to the one before for the other."""
    session = Session(mode="live", name="x")
    session.on_event(state(0, "started"))
    session.on_event(state(1, "ended"))
    session.on_event(state(1.1, "started"))
    session.on_event(estimate(Bump(d_mm=7.0), 1.2))
    session.on_event(state(2, "ended"))
    session.on_event(estimate(Bump(d_mm=9.0), 2.1))
    assert [(s.number, s.value("d_mm")) for s in session.visits.strokes()] == [(1, 7.0), (2, 9.0)]


def test_a_stroke_cut_off_by_an_unplug_is_not_finished_with_the_next_ones_frames():
    session = Session(mode="live", name="x")
    events = list(stroke(Bump(), 0.0, 0, 50.0, 1.0, 1))
    for event in events[:30]:
        session.on_event(event)
    session.on_event(LinkChanged(LinkState.GONE, "gone"))
    for event in stroke(Bump(), 10.0, 500, 50.0, 1.0, 2):
        session.on_event(event)
    (only,) = session.visits.strokes()
    assert only.number == 1 and only.frames == 50 and only.gaps == 0


def test_lost_frames_are_counted_on_the_stroke():
    session = Session(mode="live", name="x")
    for event in stroke(Bump(), 0.0, 0, 50.0, 1.0, 1):
        if not isinstance(event, Frame) or event.seq % 10 != 5:
            session.on_event(event)
    assert session.visits.strokes()[0].gaps == 5


def test_a_probe_left_on_the_tissue_for_an_hour_does_not_fill_the_memory():
    kept = FollowedStroke(number=1, visit=1, started_s=0.0)
    felt = frame(0, 0.0, 0.0, 1.0, np.ones((16, 26)))
    for n in range(20_000):
        kept.add(dataclasses.replace(felt, seq=n, time_us=5000 * n, position_um=n))
    assert len(kept.images) <= MAX_IMAGES and len(kept.position_mm) <= MAX_FRAMES
    assert kept.frames == 20_000
    detail = kept.detail()
    assert detail["traces"]["position_mm"][0] == 0.0 and detail["traces"]["position_mm"][-1] > 19.0


def test_what_is_not_finite_reaches_the_page_as_null():
    text = to_json({"a": math.nan, "b": [math.inf, 1.0], "c": ({"d": -math.inf},)})
    assert json.loads(text) == {"a": None, "b": [None, 1.0], "c": [{"d": None}]}


def test_an_estimate_without_numbers_makes_a_card():
    event = estimate(Bump(kind="unread"), 0.0, status.TOO_SHORT)
    said = card(event.estimate, event.told)
    assert said["title"] == "Stroke could not be read" and not said["rows"]
    reason = status.TEXT[status.TOO_SHORT]
    assert said["text"] == f"{reason[0].upper()}{reason[1:]}. Stroke again."


def test_a_recording_that_a_full_disk_ends_is_told_and_what_was_written_is_kept(tmp_path):
    from palpate.recording.reader import Recording
    from palpate.view.live import LiveSource

    source = LiveSource("nowhere")
    session = Session(mode="live", name="x")
    page = session.join()
    path = tmp_path / "full.mcap"
    source.start_recording(path)
    session.set_recording({"file": path.name, "since": 0.0})
    source.mark("before")

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size, before[1]))
    try:
        source.mark("after")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    source.check_recording(session.on_event)
    assert session.recording is None
    said = [m["text"] for m in page.take() if isinstance(m, dict) and m["type"] == "notice"]
    assert len(said) == 1 and "full" in said[0]
    assert any(b"before" in getattr(r, "data", b"") for _, r in Recording(path).records())


def taken_away(bump):
    """The picture of a stroke: (its image's panel, the panel of words)."""
    session = Session(mode="live", name="x")
    for event in stroke(bump, 0.0, 0, 50.0, 1.0, 1):
        session.on_event(event)
    (felt,) = session.visits.strokes()
    image, _, words, _ = stroke_figure(felt.detail()).axes[:4]
    return image, "\n".join(text.get_text() for text in words.texts)


def test_the_picture_of_a_stroke_has_the_lumps_outline_where_the_page_draws_it():
    """It had none."""
    image, words = taken_away(Bump(d_mm=12.0, across_mm=8.0, columns=(15, 22)))
    ends = [line.get_ydata() for line in image.lines if list(line.get_xdata()) == [3.0, 13.5]]
    sides = [line.get_xdata()[0] for line in image.lines if line.get_xdata()[0] == line.get_xdata()[1]]
    assert sides == [3.0, 13.5] and len(ends) == 2
    assert ends[1][0] - ends[0][0] == pytest.approx(12.0) and abs(ends[0][0] + ends[1][0]) / 2 < 3
    assert len(image.patches) == 2  # between the ends of the interval
    assert image.get_xlim() == (-19.5, 19.5)
    assert "Width not known, felt from 3.0 to 13.5 mm across" in words


def test_a_lump_that_is_not_vouched_for_has_a_dashed_outline_and_none_has_none():
    unsure, _ = taken_away(Bump(kind="outside", d_mm=20.0, columns=(0, 26)))
    assert [line.get_linestyle() for line in unsure.lines] == ["--", "--"] and not unsure.patches
    none, words = taken_away(Bump(kind="none"))
    assert not none.lines and "Width" not in words


def test_where_the_width_is_known_the_outline_in_the_picture_is_closed():
    image = Figure().subplots()
    image.set(xlim=(-19.5, 19.5), ylim=(-12, 12))
    lump = {"along_mm": 3.0, "d_mm": [10, 9, 11], "columns_mm": [0, 9], "across_mm": [5, 4, 6]}
    draw_outline(image, lump | {"width_mm": [8, 7, 10], "sure": True}, 1.0)
    (ring,) = image.lines
    assert min(ring.get_xdata()) == pytest.approx(1) and max(ring.get_xdata()) == pytest.approx(9)
    assert min(ring.get_ydata()) == pytest.approx(-3) and max(ring.get_ydata()) == pytest.approx(7)
