"""Lanes and strips, without a browser: where strokes lie side by side, and what they show of the tissue."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.stroke.area import strip
from palpate.stroke.lanes import lane_of, mark_of
from palpate.view.notices import LinkChanged, LinkState
from palpate.view.session import Session
from palpate.wire.cells import COLUMN_MM, ROW_MM
from palpate.wire.events import MARK_PREFIX, Log
from tests.host.view.synthetic import Bump, stroke

POSITIONS = np.linspace(-28.0, 28.0, 113)


def stroked(session, number, bump=None):
    for event in stroke(bump or Bump(), 10.0 * number, 100 * number, 50.0, 1.0, number):
        session.on_event(event)


def lanes(session):
    return [s.lane_mm for s in session.visits.strokes()]


def test_nobody_told_lanes_and_strokes_have_none():
    session = Session(mode="live", name="x")
    for n in range(2):
        stroked(session, n)
    assert lanes(session) == [None, None]


def test_each_stroke_goes_a_step_beside_the_last_and_a_step_of_0_stays_in_one_lane():
    session = Session(mode="live", name="x")
    session.set_lanes(True, -10.0, 20.0)
    for n in range(3):
        stroked(session, n)
    session.set_lanes(True, 5.0, 0.0)
    for n in range(3, 5):
        stroked(session, n)
    session.set_lanes(False, 5.0, 0.0)
    stroked(session, 5)
    assert lanes(session) == [-10.0, 10.0, 30.0, 5.0, 5.0, None]


def test_a_lane_told_in_mid_stroke_is_the_next_ones():
    session = Session(mode="live", name="x")
    session.set_lanes(True, 0.0, 20.0)
    events = list(stroke(Bump(), 0.0, 0, 50.0, 1.0, 1))
    for event in events[:20]:
        session.on_event(event)
    session.set_lanes(True, 40.0, 20.0)
    for event in events[20:]:
        session.on_event(event)
    stroked(session, 1)
    assert lanes(session) == [0.0, 40.0]


def test_a_stroke_that_breaks_off_leaves_its_lane_to_the_next():
    session = Session(mode="live", name="x")
    session.set_lanes(True, 0.0, 20.0)
    for event in list(stroke(Bump(), 0.0, 0, 50.0, 1.0, 1))[:20]:
        session.on_event(event)
    session.on_event(LinkChanged(LinkState.GONE, "gone"))
    for n in (1, 2):
        stroked(session, n)
    assert lanes(session) == [0.0, 20.0]


def test_another_visit_begins_in_the_first_lane():
    session = Session(mode="live", name="x")
    session.set_lanes(True, 0.0, 15.0)
    stroked(session, 0)
    session.visits.start("later")
    stroked(session, 1)
    assert lanes(session) == [0.0, 0.0]


def test_a_lane_is_noted_once_while_its_stroke_runs_and_the_note_read_back():
    session, noted = Session(mode="live", name="x"), []
    session.on_lane = lambda *told: noted.append(told)
    stroked(session, 0)
    session.set_lanes(True, 2.5, 20.0)
    stroked(session, 1)
    assert noted == [(2.5, 10.0)]


@pytest.mark.parametrize("late", [1, 5, 1000])
def test_a_noted_lane_is_read_back_as_that_of_its_stroke_however_late_the_note_stands(late):
    """A busy machine wrote one behind the end of its stroke, which had no lane again."""
    session = Session(mode="live", name="x")
    lines = (mark_of(2.5, 10.0), "the lane 2 mm by the road")
    told = [Log(0, 0, 0, MARK_PREFIX + line) for line in lines]
    first = list(stroke(Bump(), 10.0, 0, 50.0, 1.0, 1))
    for event in [*first[: late + 1], *told, *first[late + 1 :]]:
        session.on_event(event)
    stroked(session, 2)
    assert lanes(session) == [2.5, None]


def test_a_mark_of_no_lane_is_none():
    for text in ("lane", "lane 2 mm", "lane 2 mm, stroke of x s", "lane 1e9 mm, stroke of 1.000 s"):
        assert lane_of(text) is None
    assert lane_of(mark_of(-17.25, 3.0004)) == (-17.25, 3.0)


def images(across_mm, push=1.0):
    """A lump that far beside the line, under a face whose rim touches less; `push` is the hand's, (n,)."""
    face = np.outer(1 - (ROW_MM / 14) ** 2, np.clip((20 - np.abs(COLUMN_MM)) / 4, 0.02, 1))
    along = POSITIONS[:, None, None] + ROW_MM[None, :, None]
    hill = 0.3 * np.exp(-(along**2) / 2 / 4**2 - (COLUMN_MM - across_mm) ** 2 / 2 / 4**2)
    return 4.0 * face * (1 + hill) * np.broadcast_to(push, POSITIONS.shape)[:, None, None]


@pytest.mark.parametrize("across_mm", [-9.0, 0.0, 9.0])
def test_a_lump_beside_the_line_stands_out_beside_the_line(across_mm):
    found = strip(POSITIONS, images(across_mm))
    row, column = np.unravel_index(found.rise.argmax(), found.rise.shape)
    assert COLUMN_MM[column] == pytest.approx(across_mm, abs=1.5)
    assert found.x_mm[row] == pytest.approx(0.0, abs=1.5)
    assert 0.2 < found.rise.max() < 0.35
    away = np.abs(COLUMN_MM - across_mm) > 13
    assert np.abs(found.rise[:, away]).max() < 0.05


def test_a_hand_that_presses_now_more_now_less_draws_no_lump():
    push = 1 + 0.3 * np.sin(POSITIONS / 5)
    wavy = strip(POSITIONS, images(0.0, push))
    np.testing.assert_allclose(wavy.rise, strip(POSITIONS, images(0.0)).rise, atol=0.02)


def test_a_stroke_of_no_length_has_no_strip():
    assert strip(np.empty(0), np.empty((0, 16, 26))).x_mm.size == 0
    assert strip(np.zeros(9), images(0.0)[:9]).x_mm.size == 0
