"""A model's terms as a nested program: it is the same polynomial, and the probe refuses what is none."""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py import unpack
from palpate.fixedpoint import nested
from palpate.fixedpoint.nested import SIGMA, Close, Run
from palpate.fixedpoint.rounding import Rounding

FEATURES = 6
FIRST = nested.FIRST_FEATURE
LEAF, ALL = bytes((1, FIRST)), bytes((96 + FIRST + 2, *range(FIRST + 2)))
"""A program of one leaf; ln sigma's run over two features and all predictions."""
TERMS = [t for p in (1, 2, 3) for t in combinations_with_replacement(range(FEATURES), p)]


def value(steps, coefficients, u):
    """The program in float64, as the firmware runs it."""
    sums = [0.0] * 4
    left = iter(coefficients)
    for step in steps:
        depth = len(step.branch)
        if isinstance(step, Run):
            sums[depth] += sum(next(left) * u[i] for i in step.features)
        else:
            sums[depth - 1] += u[step.branch[-1]] * (sums[depth] + next(left))
            sums[depth] = 0.0
    assert sums[1:] == [0.0, 0.0, 0.0]
    return sums[0]


@settings(deadline=None)
@given(st.sets(st.sampled_from(TERMS), min_size=1), st.integers(0, 2**32 - 1))
def test_the_program_is_the_polynomial(terms, seed):
    rng = np.random.default_rng(seed)
    wanted = {term: rng.normal() for term in terms}
    u = rng.uniform(-1, 1, FEATURES)
    steps = nested.program(terms)
    order = nested.order(steps)
    assert len(set(order)) == len(order) and set(order) >= terms
    got = value(steps, [wanted.get(term, 0.0) for term in order], u)
    assert got == pytest.approx(sum(c * np.prod(u[list(t)]) for t, c in wanted.items()), abs=1e-12)


@settings(deadline=None)
@given(st.sets(st.sampled_from(TERMS), min_size=1))
def test_the_bytes_are_the_program(terms):
    steps = nested.program(terms)
    sigma = Run(SIGMA, tuple(range(FIRST + FEATURES)))
    raw = nested.to_bytes((*steps, sigma))
    assert nested.from_bytes(raw) == [*steps, sigma]
    leaves = sum(len(step.features) for step in steps if isinstance(step, Run))
    branches = sum(isinstance(step, Close) for step in steps)
    assert unpack.program(raw, FEATURES) == (leaves, branches, len(nested.to_bytes(steps)))


def test_terms_of_degree_three_share_branches():
    cubic = {(0, 0, i) for i in range(6)} | {(0, i, 3) for i in range(1, 4)}
    branches = {step.branch for step in nested.program(cubic) if isinstance(step, Close)}
    assert branches == {(0,), (0, 0), (0, 3)}


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        LEAF,  # nothing of ln sigma
        LEAF + bytes((96 + FIRST + 1, *range(FIRST + 1))),  # not all of its inputs
        bytes((1, FIRST - 1)) + ALL,  # a prediction as a leaf
        bytes((1, FIRST + 2)) + ALL,  # a feature that is not there
        bytes((32 + 1, FIRST)) + ALL,  # a branch that is not closed
        bytes((128, 0)) + ALL,  # the whole cannot be closed
        bytes((128 + 32, 2)) + ALL,  # closed with a feature that is not there
        bytes((64 + 1, FIRST, 128 + 32, 1)) + ALL,  # the inner one is not closed
        ALL + LEAF,  # the other way round
        (LEAF + ALL)[:-1],  # cut off
        bytes((0,)) + ALL,  # an empty run
    ],
)
def test_what_is_no_program_of_two_features_is_refused(raw):
    assert unpack.program(LEAF + ALL, 2) == (1, 0, 2)
    assert unpack.program(raw, 2) is None


def test_coefficients_rounded_together_err_less_than_each_for_itself():
    rng = np.random.default_rng(2)
    causes = rng.normal(size=(500, 4))
    inputs = np.c_[causes @ rng.normal(size=(4, 20)) + 0.05 * rng.normal(size=(500, 20)), np.ones(500)]
    coefficients = np.append(rng.normal(size=20), 0.0)
    together = Rounding(inputs[:250], np.arange(21)).whole(coefficients, 8) / 256
    assert np.array_equal(together[:-1] * 256, np.round(together[:-1] * 256))
    apart = np.round(coefficients * 256) / 256
    errors = [np.std(inputs[250:] @ (rounded - coefficients)) for rounded in (together, apart)]
    assert errors[0] < 0.6 * errors[1]


@pytest.mark.parametrize("seed", range(5))
def test_inputs_that_repeat_one_another_are_rounded_too(seed):
    """A fitted field model's did not: the inverse of their square was not positive definite."""
    rng = np.random.default_rng(seed)
    inputs = np.c_[np.vander(rng.uniform(0.9, 1.1, 400), 24)[:, :-1] * 10, np.zeros(400), np.ones(400)]
    coefficients = np.append(rng.normal(size=24), 0.0)
    whole = Rounding(inputs, np.arange(25)).whole(coefficients, 10)
    assert np.array_equal(whole[:-1], np.round(whole[:-1])) and np.isfinite(whole).all()
    together, apart = whole / 1024, np.round(coefficients * 1024) / 1024
    assert np.std(inputs @ (together - coefficients)) < np.std(inputs @ (apart - coefficients))
