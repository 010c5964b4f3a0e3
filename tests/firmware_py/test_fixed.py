"""The arithmetic under everything: as exact as promised, and never outside 31 bits."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py import fixed
from tests.firmware_py import checked_int

ONE = 1 << 24
watched, watch = checked_int.load(("fixed",))


@given(st.integers(1, 2**30 - 1))
def test_ln_is_exact_to_2e_7(x):
    got = watched.fixed.ln(x)
    assert got == fixed.ln(x)
    assert abs(got / ONE - math.log(x)) < 2e-7


def test_ln_of_every_power_of_two_and_its_neighbours():
    for e in range(30):
        for x in {max(1, (1 << e) - 1), 1 << e, (1 << e) + 1}:
            assert abs(watched.fixed.ln(x) / ONE - math.log(x)) < 2e-7
    assert fixed.ln(0) == fixed.ln(-5) == 0


@given(st.integers(-(2**29), 2**29), st.integers(0, 30))
def test_exp_is_exact_to_2e_6(v, shift):
    got = watched.fixed.exp(v, shift)
    assert got == fixed.exp(v, shift)
    true = math.exp(v / ONE) * 2.0 ** (24 - shift)
    if true < 2**29:
        assert abs(got - true) <= 3e-7 * true + 1
    else:
        assert got >= 2**29 * (1 - 1e-6)


def test_exp_over_its_whole_range_where_it_has_all_its_bits():
    worst = 0.0
    for v in range(-8 * ONE, 3 * ONE, 4099):
        true = math.exp(v / ONE)
        shift = max(0, math.ceil(v / ONE / math.log(2)) - 4)
        got = fixed.exp(v, shift) / 2.0 ** (24 - shift)
        if true > 0.5:
            worst = max(worst, abs(got / true - 1))
    assert worst < 2e-6


@given(st.integers(-(2**29) + 1, 2**29 - 1), st.integers(-(2**29) + 1, 2**29 - 1))
def test_mul_rounds_the_exact_product_down(a, b):
    if abs(a * b) < 2**53:
        assert watched.fixed.mul(a, b) == a * b >> 24


@given(st.integers(-(2**30) + 1, 2**30 - 1), st.integers(1, 2**30 - 1))
def test_ratio_divides_or_saturates(a, b):
    got = watched.fixed.ratio(a, b)
    assert got == fixed.ratio(a, b)
    if abs(a) < 31 * b:
        assert abs(got / ONE - a / b) <= 1e-6 * (1 + abs(a / b))
    elif abs(a) >= 33 * b:
        assert got == (fixed.LIMIT if a > 0 else -fixed.LIMIT)


@given(st.integers(-(2**29) + 1, 2**29 - 1))
def test_asinh_is_exact_to_2e_6(x):
    got = watched.fixed.asinh(x)
    assert abs(got / ONE - math.asinh(x / ONE)) < 2e-6
    assert x == 0 or watched.fixed.asinh(-x) == -got


def test_the_watch_sees_what_leaves_the_range():
    modules, _ = checked_int.load(("fixed",))
    with pytest.raises(checked_int.LeftTheRange):
        modules.fixed.mul(2**29, 2**29)
    with pytest.raises(checked_int.LeftTheRange):
        modules.fixed.ratio(2**40, 3)


def test_the_arithmetic_comes_close_to_its_limit_in_these_tests():
    """So the range is really tried, not only promised."""
    for x in (1, 2**22 - 1, 2**30 - 1):
        watched.fixed.ln(x)
    assert 2**29 < watch.most < 2**30
