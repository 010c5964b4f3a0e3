"""What the page rests on: bounded mailboxes, the growing map, words, repeatability, strokes put together."""

from __future__ import annotations

import dataclasses
import json
import math
import resource
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.comparison.change import compare, spread
from palpate.features.gaussian import bump
from palpate.sim.probe.cells import ROW_MM
from palpate.view.assemble import Assembler
from palpate.view.events import (  # fmt: skip
    Estimate,
    Frame,
    LinkChanged,
    LinkState,
    StrokeState,
)
from palpate.view.mailbox import Mailbox
from palpate.view.page_connection import to_json
from palpate.view.phrases import card
from palpate.view.session import Session
from palpate.view.stroke import MAX_FRAMES, MAX_IMAGES, Stroke
from palpate.view.tactile_map import columns_over_lump, fit_growing_map, method_2
from tests.host.view.synthetic import Bump, estimate, stroke
from tests.host.view.waiting import eventually

# ---- the newest wins


def test_a_page_that_does_not_read_keeps_one_frame_and_it_is_the_newest():
    mailbox = Mailbox()
    for n in range(10_000):
        mailbox.put_slot("frame", n.to_bytes(4, "little"))
    assert len(mailbox) == 1 and mailbox.replaced == 9_999
    assert mailbox.take() == [(9_999).to_bytes(4, "little")]


def test_events_keep_their_order_and_come_before_frames():
    mailbox = Mailbox()
    mailbox.put_slot("frame", b"f")
    for n in range(5):
        mailbox.put_event({"n": n})
    assert mailbox.take(with_frame=False) == [{"n": n} for n in range(5)]
    assert mailbox.take() == [b"f"]


def test_nothing_older_is_told_after_something_newer():
    """A slow page would else show a running stroke for good that is long over."""
    mailbox = Mailbox()
    mailbox.put_slot("progress", {"running": 1})
    mailbox.put_event({"finished": 1})
    mailbox.put_slot("visits", {"strokes": 1})
    mailbox.put_slot("state", {"stroke": False})
    mailbox.put_event({"link": "gone"})
    mailbox.put_slot("visits", {"strokes": 2})
    told = [*mailbox.take()]
    assert told == [{"running": 1}, {"finished": 1}, {"stroke": False}, {"link": "gone"}, {"strokes": 2}]


def test_a_page_hundreds_of_events_behind_is_told_everything_afresh():
    mailbox = Mailbox(max_events=10)
    for n in range(1000):
        mailbox.put_event({"n": n})
    assert mailbox.overflowed and len(mailbox) == 0
    mailbox.reset()
    mailbox.put_event({"n": 0})
    assert not mailbox.overflowed and mailbox.take() == [{"n": 0}]


def test_memory_stays_bounded_when_no_page_reads():
    session = Session(mode="live", name="x")
    mailbox = session.join()
    for number in range(400):
        for event in stroke(Bump(), number * 2.0, number * 60, 30.0, 2.0, number):
            session.on_event(event)
    assert len(mailbox) <= 262
    assert len(session.visits.strokes()) == 400
    assert sum(len(s.images) > 0 for s in session.visits.strokes()) <= 101


# ---- the growing map


@given(
    base=st.floats(1, 10), amp=st.floats(0.3, 5), centre=st.floats(-8, 8), stdev=st.floats(3, 8),
)  # fmt: skip
def test_a_whole_strokes_map_gives_its_gaussian_back(base, amp, centre, stdev):
    position = np.linspace(-40, 40, 161)
    place = position[:, None] + ROW_MM[None, :]
    rows = bump(place, base, amp, centre, stdev)
    x, p, covered = method_2(position, rows)
    whole = covered == 16
    fit = fit_growing_map(x[whole], p[whole])
    assert fit is not None
    assert fit.base_kPa == pytest.approx(base, rel=0.01)
    assert fit.amp_kPa == pytest.approx(amp, rel=0.02)
    assert fit.centre_mm == pytest.approx(centre, abs=0.05)
    assert fit.stdev_mm == pytest.approx(stdev, rel=0.03)


def test_where_only_part_of_the_face_has_been_the_face_itself_leaves_no_mark():
    position = np.linspace(-20, 20, 81)
    face = 1.0 - 0.4 * (ROW_MM / 12.0) ** 2
    _, p, _ = method_2(position, np.tile(4.0 * face, (81, 1)))
    assert np.ptp(p) < 1e-9


@pytest.mark.parametrize("n", [0, 1, 2])
def test_a_stroke_that_has_hardly_begun_has_no_map_and_no_fit(n):
    x, p, _ = method_2(np.zeros(n), np.ones((n, 16)))
    assert x.size == p.size == 0 and fit_growing_map(x, p) is None


def test_noise_alone_gets_no_fit():
    rng = np.random.default_rng(5)
    x = np.arange(-30.0, 31.0)
    found = [fit_growing_map(x, 4 + rng.normal(0, 0.01, x.size)) for _ in range(40)]
    assert sum(f is not None for f in found) <= 4


def test_a_ball_is_looked_at_through_the_columns_over_it():
    position = np.linspace(-30, 30, 41)
    along = np.exp(-0.5 * ((position[:, None] + ROW_MM[None, :]) / 4.6) ** 2)
    across = np.exp(-0.5 * ((np.arange(26) - 18) / 2.6) ** 2)
    used = columns_over_lump(4.0 + 1.0 * along[:, :, None] * across[None, None, :])
    assert used.min() >= 13 and used.max() <= 23 and 18 in used
    assert columns_over_lump(np.full((41, 16, 26), 4.0)).size == 26


# ---- strokes


def test_frames_before_the_probe_says_started_belong_to_the_stroke_and_those_in_the_air_do_not():
    assembler = Assembler(lambda t: Stroke(number=1, visit=1, started_s=t))

    def frame(n):
        return Frame(n, n * 0.01, 0.0, float(n), 1.0, np.ones((16, 26), np.float32))

    for n in range(5):
        assembler.feed(frame(n))
    assembler.feed(StrokeState(0.05, contact=True))
    for n in range(5, 9):
        assembler.feed(frame(n))
    assembler.feed(StrokeState(0.09, contact=True, stroke=True))
    for n in range(9, 20):
        assembler.feed(frame(n))
    assembler.feed(StrokeState(0.2))
    assert assembler.running is None
    done = assembler.feed(estimate(Bump(), 0.21))
    assert done is not None and done.position_mm == [float(n) for n in range(5, 20)]
    assert done.started_s == pytest.approx(0.09) and done.gaps == 0


def test_a_lost_estimate_does_not_go_to_the_next_stroke():
    session = Session(mode="live", name="x")
    for state in (
        StrokeState(0, True, True),
        StrokeState(1, True),
        StrokeState(2, True, True),
        StrokeState(3),
    ):
        session.on_event(state)
    session.on_event(estimate(Bump(d_mm=7.0), 3.1))
    first, second = session.visits.strokes()
    assert first.estimate is None and first.summary()["card"]["title"] == "No answer from the probe"
    assert second.value("d_mm") == 7.0


def test_a_late_estimate_goes_to_its_own_stroke_though_the_next_has_begun():
    """It was "No answer" for the one, and the answer to the one before for the other."""
    session = Session(mode="live", name="x")
    session.on_event(StrokeState(0, True, True))
    session.on_event(StrokeState(1, True))
    session.on_event(StrokeState(1.1, True, True))
    session.on_event(estimate(Bump(d_mm=7.0), 1.2))
    session.on_event(StrokeState(2, True))
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
    kept = Stroke(number=1, visit=1, started_s=0.0)
    pressure = np.ones((16, 26), np.float32)
    for n in range(20_000):
        kept.add(Frame(n, n * 0.005, 0.0, n * 0.001, 1.0, pressure))
    assert len(kept.images) <= MAX_IMAGES and len(kept.position_mm) <= MAX_FRAMES
    assert kept.frames == 20_000
    detail = kept.detail()
    assert detail["traces"]["position_mm"][0] == 0.0 and detail["traces"]["position_mm"][-1] > 19.0


# ---- words


def test_nothing_is_said_of_a_lump_where_none_was_found():
    said = card(estimate(Bump(kind="none"), 0.0))
    assert said["hardness"] is None and said["E_ratio"] is None
    assert [row["key"] for row in said["rows"]] == ["F_N_per_m"]


def test_every_card_carries_the_line():
    for kind in ("lump", "none", "outside", "force", "unread"):
        assert card(estimate(Bump(kind=kind), 0.0))["notice"] == "Research use, not a diagnosis."
    assert card(None)["notice"] == "Research use, not a diagnosis."


def test_what_is_not_finite_reaches_the_page_as_null():
    text = to_json({"a": math.nan, "b": [math.inf, 1.0], "c": ({"d": -math.inf},)})
    assert json.loads(text) == {"a": None, "b": [None, 1.0], "c": [{"d": None}]}


# ---- repeatability


def test_two_strokes_of_one_lump_stay_within_repeatability_as_often_as_it_says():
    rng = np.random.default_rng(3)
    draws = rng.normal(10.0, 0.4, 4000)
    found = spread(draws.tolist())
    assert found is not None and found.repeatability is not None
    share = np.mean(np.abs(draws[::2] - draws[1::2]) <= found.repeatability)
    assert share == pytest.approx(0.95, abs=0.015)


def test_no_change_is_called_a_change_in_one_case_of_twenty():
    rng = np.random.default_rng(4)
    wrong = 0
    for _ in range(2000):
        found = compare(rng.normal(10, 0.4, 3).tolist(), rng.normal(10, 0.4, 4).tolist())
        wrong += bool(found and found.beyond)
    assert wrong / 2000 == pytest.approx(0.05, abs=0.015)


@given(a=st.lists(st.floats(5, 30), min_size=2, max_size=8), by=st.floats(-4, 4))
def test_the_change_is_the_difference_of_the_means(a, by):
    found = compare(a, [v + by for v in a])
    assert found is not None and found.change == pytest.approx(by, abs=1e-9)
    assert found.change_low is not None and found.change_high is not None
    assert found.change_low <= found.change <= found.change_high
    assert found.beyond == (not found.change_low <= 0 <= found.change_high)


@pytest.mark.parametrize(("a", "b"), [([10.0], [12.0]), ([10.0, 10.1], [12.0])])
def test_one_stroke_in_a_visit_tells_nothing(a, b):
    found = compare(a, b)
    assert found is not None and found.beyond is None and "At least two strokes" in found.text
    assert compare([], b) is None


def test_identical_strokes_do_not_divide_by_zero():
    found = compare([10.0, 10.0], [10.0, 10.0])
    assert found is not None and found.beyond is False


# ---- threads


def test_events_and_snapshots_from_many_threads_do_not_meet():
    session = Session(mode="live", name="x")
    stop = threading.Event()
    seen = []
    ready = threading.Barrier(4)

    def read():
        mailbox = session.join()
        ready.wait()
        while not stop.is_set():
            seen.append(len(json.dumps(session.snapshot())))
            mailbox.take()
        session.leave(mailbox)

    readers = [threading.Thread(target=read) for _ in range(3)]
    for reader in readers:
        reader.start()
    ready.wait()
    for number in range(6):
        for event in stroke(Bump(), number * 2.0, number * 40, 20.0, 2.0, number):
            session.on_event(event)
        told = len(seen)
        eventually(lambda told=told: len(seen) > told)
    stop.set()
    for reader in readers:
        reader.join()
    assert len(session.visits.strokes()) == 6


def test_an_estimate_without_numbers_makes_a_card():
    empty = Estimate(0.0, invalid=True, status_text="the stroke is too short: stroke on")
    said = card(dataclasses.replace(empty))
    assert said["title"] == "Stroke could not be read"
    assert said["text"] == "The stroke is too short: stroke on. Stroke again."


# ---- recording


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
