"""The answer of a visit: several strokes over one lump, pooled."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate import models
from palpate.answer.visit import HOW, LEAST_COMMON, pool, visit_answer
from palpate.firmware_twin.replay_core import Replay
from palpate.model_export.integers import force_map
from palpate.model_export.integers.reference import evaluate, inputs
from palpate.sim.probe.over_lump import strokes_over
from palpate.sim.tissue import Case
from palpate.wire.events import OUTPUTS
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


def spans_of(*errors):
    return [tuple(TRUE_MM * np.exp([e, e - Z * SD, e + Z * SD])) for e in errors]


def wide(span):
    return math.log(span[2] / span[1]) / (2 * Z * SD)


def test_however_strokes_scatter_half_of_a_strokes_variance_stays():
    """Strokes that scatter as their intervals say share nothing, but for what no model knows of a lump."""
    errors = np.random.default_rng(3).normal(size=12)
    errors = SD * (errors - errors.mean()) / errors.std(ddof=1)
    assert math.sqrt(LEAST_COMMON) < wide(pool(spans_of(*errors), LEVEL)) < 0.9


def test_two_strokes_make_no_wider_interval_than_one_of_them():
    """Student's t of two strokes is six times a normal interval."""
    two = spans_of(-0.7 * SD, 0.7 * SD)
    assert wide(pool(two, LEVEL)) == pytest.approx(1.0, abs=0.01)


def test_strokes_of_another_model_are_left_out():
    before, now = answers(Bump(d_mm=18.0), Bump(d_mm=18.0)), answers(Bump(d_mm=12.0), Bump(d_mm=12.0))
    before = [(replace(said, model_id=b"ANOTHER1"), told) for said, told in before]
    found = visit_answer([*before, *now])
    assert (found.strokes, found.left_out) == (2, 2) and found.spans["d_mm"][0] == pytest.approx(12.0)
    assert visit_answer([*before, now[0]]) is None


def test_strokes_that_are_all_unsure_are_unsure_together_and_soft_ones_soft():
    unsure = Bump(E_inv23=0.2, hardness="unsure")
    assert visit_answer(answers(unsure, unsure)).hardness == "unsure"
    soft = Bump(E_inv23=0.45, hardness="soft")
    assert visit_answer(answers(soft, soft)).hardness == "soft"


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


@pytest.mark.long
def test_of_simulated_strokes_most_of_an_intervals_variance_is_common_and_the_pooled_one_holds():
    """Visits of five strokes, each over a lump that the model has not met, with typical sensors and hand."""
    held, common = [], []
    for code in ("d10h08e10f10", "d12h07e20f06", "d13h09e20f07", "d10h06e10f08"):
        case = Case.from_code(code)
        spec = models.load(models.suited_to(case))
        replay = Replay(None if spec.force_map is None else force_map.blob(spec.force_map))
        streams, calibration = strokes_over(case, "typical", 1000, strokes=30)
        found = []
        for stream in streams:
            assert replay.stream(stream, calibration) == 0
            found.append(replay.features())
        said = evaluate(spec, inputs(spec, np.array(found)))
        for j, true in ((OUTPUTS.index("d_mm"), case.d_mm), (OUTPUTS.index("t_mm"), case.t_mm)):
            value, low, high = (said[part][:, j] for part in ("value", "low", "high"))
            spans = list(zip(value, low, high))
            pooled = [pool(spans[n : n + 5], LEVEL) for n in range(0, 30, 5)]
            held += [a <= true <= b for _, a, b in pooled]
            of_one = np.mean((np.log(high / low) / (2 * Z)) ** 2)
            common.append(1 - np.var(np.log(value), ddof=1) / of_one)
    print(f"pooled intervals hold {np.mean(held):.2f}; common to all strokes {np.mean(common):.2f}")
    assert np.mean(held) >= LEVEL
    assert min(common) > LEAST_COMMON
