"""What is worked out of an estimate: depth with its interval, stiffness as a factor."""

from __future__ import annotations

from math import exp, log

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.answer.words import stiffness_words
from palpate.spans import depth_mm, stiffness

WIDTH_90 = 1.645

TOLD = (10.0, 10.0, 10.0)


def around(value: float, width: float) -> tuple[float, float, float]:
    return value, value * exp(-width), value * exp(width)


@given(
    d=st.floats(4, 30),
    h=st.floats(0.1, 3),
    w=st.floats(0.001, 0.3),
    v=st.floats(0.001, 0.3),
    u=st.floats(0.001, 0.6),
)
def test_depth_is_the_fat_over_the_lump_with_an_interval_round_it(d, h, w, v, u):
    value, low, high = depth_mm(around(d * (h + 0.5), w), around(d, v), around(h, u))
    assert value == pytest.approx(d * h, rel=1e-6)
    assert 0.0 <= low <= value <= high


@given(st.floats(-5, 40), st.floats(-5, 40), st.floats(-1, 3))
def test_numbers_that_make_no_sense_give_a_depth_that_is_not_negative(t, d, h):
    value, low, high = depth_mm((t, t - 1, t + 1), (d, d - 1, d + 1), (h, h - 1, h + 1))
    assert 0.0 <= low <= value <= high or value == 0.0


@pytest.mark.parametrize("together", [-0.5, 0.0, 0.6, 0.9])
def test_the_depths_interval_covers_what_it_says_however_the_errors_go_together(together):
    """Taken as independent, t and d gave intervals that covered 97 % where 90 % was said."""
    rng = np.random.default_rng(1)
    d, h, width_t, width_d = 12.0, 0.8, 0.03, 0.06
    t = d * (h + 0.5)
    cov = together * width_t * width_d
    errors = rng.multivariate_normal([0, 0], [[width_t**2, cov], [cov, width_d**2]], 4000)
    width_ratio = np.std(errors[:, 0] - errors[:, 1])
    hits = 0
    for e_t, e_d in errors:
        said_t, said_d = t * exp(e_t), d * exp(e_d)
        said_h = said_t / said_d - 0.5
        width_h = width_ratio * (said_h + 0.5) / said_h
        parts = zip((said_t, said_d, said_h), (width_t, width_d, width_h))
        _, low, high = depth_mm(*(around(v, WIDTH_90 * w) for v, w in parts))
        hits += low <= d * h <= high
    assert 0.88 < hits / len(errors) < 0.92


@given(x=st.floats(-0.2, 0.7), w=st.floats(0.0, 0.4))
def test_stiffness_keeps_its_order_and_says_where_it_has_no_bound(x, w):
    value, low, high = stiffness((x, x - w, x + w))
    if low is not None and high is not None and value is not None:
        assert low <= value <= high <= 50.0
    if x - w <= 0.0:
        assert high is None


def test_a_factor_is_said_as_an_interval_or_as_a_bound():
    assert stiffness_words((0.05, -0.1, 0.17)) == "over 14 × fat"
    assert stiffness_words((0.3, 0.2, 0.4)) == "6.1 (4 to 11) × fat"
    assert stiffness_words((0.3, 0.2, 0.4), TOLD) == "6.1 (4 to 11) × fat, 61 (40 to 112) kPa"
    assert stiffness_words((0.05, -0.1, 0.17), TOLD) == "over 14 × fat, over 143 kPa"
    assert stiffness_words((0.3, 0.2, 0.4), (10.0, 8.0, 12.0)) == "6.1 (4 to 11) × fat, 61 (37 to 115) kPa"
    assert log(14.3) == pytest.approx(-1.5 * log(0.17), abs=0.02)
