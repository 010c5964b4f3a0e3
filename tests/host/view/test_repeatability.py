"""How well strokes repeat, and when a change between visits is more than chance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.stroke.change import compare, spread


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
