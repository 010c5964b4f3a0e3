"""The probe's map comes behind its estimate: the stroke that is shown has both, however slow the probe."""

from __future__ import annotations

import dataclasses

import pytest

from palpate.stroke.answered import MAP_PATIENCE_US, AnsweredEvents
from palpate.stroke.assemble import Assembler
from palpate.stroke.stroke import FollowedStroke
from palpate.wire import events as link
from palpate.wire.scale import NOMINAL

SECOND_US = 1_000_000


def event(kind, **given):
    """One of the link's events; what is not given is nothing."""
    empty = {"values": (), "state": "", "packed": bytes(624), "model_id": bytes(8), "scale": NOMINAL}
    return kind(**{f.name: empty.get(f.name, 0) for f in dataclasses.fields(kind) if f.init} | given)


ESTIMATE = event(link.Estimate, stream=1, stroke=1, time_us=2 * SECOND_US)
MAP = event(link.TactileMap, stream=1, stroke=1, points=3, values=(1, 2, 1), count_mpa=1000)


def frame(time_us):
    return event(link.Frame, time_us=time_us)


def finished(events):
    """The strokes that these events finish, after a stroke from 1 to 2 s."""
    answers = AnsweredEvents()
    assembler = Assembler(lambda t: FollowedStroke(number=1, visit=1, started_s=t))
    began = [(0, "contact"), (1, "started"), (2, "ended")]
    states = [event(link.StrokeState, state=state, time_us=t * SECOND_US) for t, state in began]
    shown = [each for one in [*states, *events] for each in answers.feed(one)]
    return [stroke for each in shown if (stroke := assembler.feed(each)) is not None]


@pytest.mark.parametrize("thinking_s", [0.5, 3, 60])
def test_a_map_behind_the_estimate_belongs_to_its_stroke(thinking_s):
    """A probe that thought for three seconds had the viewer's own map shown in place of its own."""
    answered_us = round((2 + thinking_s) * SECOND_US)
    (stroke,) = finished([ESTIMATE, frame(answered_us), frame(answered_us + SECOND_US), MAP])
    assert stroke.estimate is not None
    assert stroke.map is not None and stroke.detail(images=False)["map"]["by"] == "probe"


def test_a_map_that_was_lost_does_not_keep_the_estimate_back_for_ever():
    answered_us = 5 * SECOND_US
    (stroke,) = finished([ESTIMATE, frame(answered_us), frame(answered_us + MAP_PATIENCE_US + 1)])
    assert stroke.estimate is not None and stroke.map is None
