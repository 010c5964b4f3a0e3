"""Two lumps side by side: what each changes, added up."""

import numpy as np
import pytest

from palpate.sim.probe.sensors import StrokeField
from palpate.sim.probe.two_lumps import TwoLumps, random_pair

X = np.linspace(-30, 30, 13)


def test_far_apart_each_is_felt_by_itself(all_strokes):
    strokes = all_strokes[0]
    one, two = StrokeField(*strokes), TwoLumps(*strokes, apart_mm=56.0)
    near = np.array([-2.0, 0.0, 2.0])
    for place in (-28.0, 28.0):
        image, depth = two.at(near + place)
        alone, alone_mm = one.at(near)
        assert image == pytest.approx(alone, abs=0.02 * alone.max())
        assert depth == pytest.approx(alone_mm, rel=0.01)


def test_the_force_is_that_of_one(all_strokes):
    strokes = all_strokes[0]
    image, _ = TwoLumps(*strokes, apart_mm=12.0).at(X)
    alone, _ = StrokeField(*strokes).at(X)
    assert image.sum(axis=1) == pytest.approx(alone.sum(axis=1), rel=0.02)


def test_a_pair_is_even_about_its_middle_where_both_are_alike(all_strokes):
    image, depth = random_pair(all_strokes[0], (12.0, 12.0), np.random.default_rng(1)).at(X)
    assert depth == pytest.approx(depth[::-1], rel=0.01)
    assert image == pytest.approx(image[::-1, ::-1], abs=0.01 * image.max())


def test_a_random_pair_lies_between_its_ends(all_strokes):
    for seed in range(5):
        pair = random_pair(all_strokes[0], (8.0, 20.0), np.random.default_rng(seed))
        assert 8 <= pair.apart_mm <= 20 and 0.4 <= pair.share <= 1
