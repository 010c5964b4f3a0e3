"""The answer of a visit: several strokes over one lump, pooled."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.answer.visit import HOW, pool, visit_answer
from tests.host.view.synthetic import Bump, estimate

LEVEL, Z = 0.9, 1.6449
TRUE_MM, SD = 10.0, 0.05
"""Of the logarithm of one stroke's diameter."""


def answers(*bumps: Bump):
    found = [estimate(bump, 1.0 + n) for n, bump in enumerate(bumps)]
    return [(one.estimate, one.told) for one in found]


@pytest.mark.parametrize("strokes", [2, 3, 5, 10])
@pytest.mark.parametrize("common", [0.0, 0.5, 1.0])
def test_the_pooled_interval_holds_the_truth_as_often_as_it_says(strokes, common):
    """common: share of one stroke's variance that all strokes over the lump have alike."""
    rng = np.random.default_rng([strokes, round(10 * common)])
    held, widths = [], []
    for _ in range(400):
        shared = rng.normal() * math.sqrt(common)
        errors = SD * (shared + rng.normal(size=strokes) * math.sqrt(1 - common))
        spans = [tuple(TRUE_MM * np.exp([e, e - Z * SD, e + Z * SD])) for e in errors]
        _, low, high = pool(spans, LEVEL)
        held.append(low <= TRUE_MM <= high)
        widths.append(math.log(high / low) / (2 * Z * SD))
    assert np.mean(held) > LEVEL - 0.045  # three standard errors of 400
    if strokes == 10:
        ideal = math.sqrt(common + (1 - common) / strokes)
        assert np.mean(widths) < max(ideal, 0.75) + 0.1


def test_strokes_that_agree_better_than_their_intervals_make_them_no_surer_of_what_they_share():
    one = (10.0, 9.2, 10.9)
    assert pool([one] * 8, LEVEL) == pytest.approx(one, rel=1e-3)


def test_strokes_that_contradict_each_other_make_a_wider_interval_than_one():
    _, low, high = pool([(8.0, 7.6, 8.4), (12.0, 11.6, 12.4)], LEVEL)
    assert low < 8.0 and high > 12.0


def test_what_the_model_was_told_stays_told():
    assert pool([(10.0, 10.0, 10.0)] * 3, LEVEL) == (10.0, 10.0, 10.0)


def test_a_place_on_both_sides_of_the_line_is_pooled_as_it_is():
    value, low, high = pool([(-0.5, -2.0, 1.0), (0.7, -0.8, 2.2), (0.1, -1.4, 1.6)], LEVEL)
    assert low < 0 < high and value == pytest.approx(0.1, abs=0.01)


def test_strokes_that_are_hard_and_unsure_in_turn_have_one_answer():
    hard = Bump(d_mm=12.0, E_inv23=0.08)
    unsure = Bump(d_mm=12.6, E_inv23=0.12, hardness="unsure")
    soft_outside = Bump(kind="outside", d_mm=30.0)
    found = visit_answer(answers(hard, unsure, soft_outside, hard, Bump(kind="none"), unsure, hard))
    assert (found.strokes, found.left_out) == (5, 2)
    assert found.hardness == "hard"
    said = found.as_dict()
    assert said["d_mm"]["low"] < 12.0 < said["d_mm"]["high"] and said["how"] == HOW
    assert said["E_ratio"]["low"] > 10


def test_one_stroke_or_none_has_no_answer_of_a_visit():
    assert visit_answer([]) is None
    assert visit_answer(answers(Bump(), Bump(kind="none"))) is None
    assert visit_answer([(None, None), *answers(Bump())]) is None
