"""What follows from several intervals: the depth, of t, d and h."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.spans import depth_mm


def around(value, share):
    return value, value * (1 - share), value * (1 + share)


SHARE = st.floats(0.01, 0.4)


@given(st.floats(4, 40), st.floats(0.1, 4), st.floats(0.55, 4), st.tuples(SHARE, SHARE, SHARE))
def test_where_t_d_and_h_contradict_each_other_the_interval_holds_what_either_says(d, h, off, shares):
    """Three numbers of which two said 5 mm and one 15 gave 5 mm, surely; no test noticed."""
    t = off * d * (h + 0.5)
    value, low, high = depth_mm(*(around(v, share) for v, share in zip((t, d, h), shares)))
    assert low <= value <= high and value == pytest.approx(d * h)
    other = max(t - d / 2, d * h / 2)  # a lump that would stand out of the tissue tells no depth
    assert low <= other * 1.0001 and other <= high * 1.0001


def test_where_they_agree_the_depth_is_surer_than_two_independent_errors():
    d, h = 12.0, 0.8
    value, low, high = depth_mm(around(d * (h + 0.5), 0.04), around(d, 0.07), around(h, 0.09))
    assert value == pytest.approx(d * h)
    assert 1.02 < high / value < 1.12 and high / value == pytest.approx(value / low)
