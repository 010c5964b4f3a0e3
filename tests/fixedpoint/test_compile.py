"""Polynomials of any number of features, outputs and terms, of any degree, over any ranges."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.fixedpoint import compile
from tests.fixedpoint import running

ENDS = st.tuples(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6)).map(
    lambda v: (v[0], v[0] + v[1] + 1e-6 * abs(v[0]))
)
"""An integer has no room for less of a box's width beside its distance from zero."""


@st.composite
def polynomials(draw):
    box = draw(st.lists(ENDS, min_size=1, max_size=6))
    terms = draw(st.sets(st.lists(st.integers(0, len(box) - 1), max_size=4).map(lambda t: tuple(sorted(t))),
                         min_size=1, max_size=8))  # fmt: skip
    outputs = draw(st.integers(1, 3))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    coefficients = rng.normal(size=(outputs, len(terms))) * 10.0 ** rng.uniform(-6, 6, (outputs, 1))
    return sorted(terms), coefficients, box


@settings(deadline=None, max_examples=10)
@given(polynomials())
def test_any_polynomial_is_met_within_a_hundred_thousandth(polynomial):
    terms, coefficients, box = polynomial
    middle, half = [(a + b) / 2 for a, b in box], [(b - a) / 2 for a, b in box]
    program = compile(terms, coefficients, box, len(coefficients), centre=middle, scale=half)
    assert program.proof.largest < 2**30
    for error in program.errors:
        assert error.rms <= 1e-5 * error.spread
    assert running.largest(program, running.vectors(program)) <= program.proof.largest


def test_the_polynomial_of_features_far_from_zero_loses_nothing():
    """(x - 1e6)^2 written out: its parts are 1e12, what is left of them 1e4."""
    program = compile([(0, 0), (0,), ()], [1.0, -2e6, 1e12], [(1e6 - 100, 1e6 + 100)])
    assert program.values([[1e6 + 50]])[0, 0] == pytest.approx(2500, abs=0.1)
    assert running.worst(program) < 1e-5


def test_thirty_features_and_forty_outputs():
    rng = np.random.default_rng(1)
    program = compile([(i,) for i in range(30)], rng.normal(size=(40, 30)), [(-1, 1)] * 30, 40)
    assert len(program.outputs) == 40 and running.worst(program) < 1e-5


def test_features_beyond_the_box_are_held_at_its_ends():
    program = compile([(0,)], [3.0], [(-2, 5)])
    assert program.values([[-100.0], [5.0], [1e9]])[:, 0] == pytest.approx([-6, 15, 15], abs=1e-4)


def test_the_proof_says_where_the_narrowest_margin_is():
    program = compile([(0,), (0, 1)], [1.0, 2.0], [(0, 1), (0, 1)])
    assert program.proof.where and program.proof.headroom_bits > 0
    assert program.proof.where in str(program.proof)


def test_the_same_model_gives_the_same_source():
    model = ([(0,), (1, 1)], [1.0, 2.0], [(0, 1), (0, 1)])
    assert compile(*model).python() == compile(*model).python()
