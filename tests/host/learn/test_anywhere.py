"""Lumps that lie anywhere: place and intervals of those left out."""

import numpy as np
import pytest

from palpate.answer.layers import BORDER, FAT, GLAND, UNSURE, half_widths, lump_layer, odds, said, values
from palpate.answer.words import place_words, size_words
from palpate.learn.anywhere import SURE, TOLD, AnywhereStudy, fit_layers, slope_of, true_values
from palpate.learn.probe_model import OUTPUTS
from palpate.learn.scopes import true_place
from palpate.model_export.schema import Layers
from tests.host.learn.made_up import smooth


def anywhere(lumps, seed):
    """Two strokes over each of some lumps in any layer."""
    return smooth(lumps, 2, np.random.default_rng(seed), depth=(1.9, 0.9), t=(2.4, 0.9))


def test_lumps_left_out_are_covered_and_their_place_is_told():
    found = AnywhereStudy.held_out(anywhere(130, 3), folds=3)
    true, said = true_place(found.seen), found.said
    told = said != UNSURE
    assert told.mean() > 0.5
    assert (said == true)[told].mean() > 0.85
    y, half, truth = found.told
    assert 0.8 < (np.abs(y - truth) <= half).mean() < 0.98
    cells = found.cells("all", np.ones(len(true), bool))
    assert len(cells) == len(TOLD) + 3 and cells[-1] == "130"
    estimates, places, together = found.further_tables()
    assert [row[0] for row in places[2]] == [
        "in the fat",
        "at the border",
        "in the gland",
        "right where it is said",
    ]
    assert len(estimates[2]) == len(together[2]) == len(found.groups())


def test_the_place_follows_from_how_much_lies_in_the_fat():
    seen = anywhere(40, 1)
    d, depth, t = (np.exp(seen.of(name)) for name in ("ln d", "ln depth", "ln t"))
    assert true_values(seen, 0.0)[:, 0] == pytest.approx(np.clip((t - depth) / d, -1, 2))
    assert (true_place(seen)[t > depth + d] == FAT).all()
    assert (true_place(seen)[t < depth] == GLAND).all()
    share, half = np.array([1.5, 0.5, -0.5, 1.02, 0.5]), np.array([0.3, 0.3, 0.3, 0.3, 2.0])
    chances = odds(share, half, 0.9)
    assert chances.sum(1) == pytest.approx(np.ones(5))
    assert list(said(chances, SURE)) == [FAT, BORDER, GLAND, UNSURE, UNSURE]


def test_errors_that_cancel_in_a_combination_are_found_and_it_is_known_better_than_the_size():
    """Soft and large looks like hard and small: the errors of both go together."""
    seen = anywhere(100, 2)
    rng = np.random.default_rng(5)
    y = seen.truth + 0.01 * rng.standard_normal((len(seen), len(OUTPUTS)))
    e = 0.1 * rng.standard_normal(len(y))
    y[:, OUTPUTS.index("ln d")] += 0.8 * e
    y[:, OUTPUTS.index("E^-2/3")] += e
    assert slope_of(y, seen.truth) == pytest.approx(-0.8, abs=0.02)
    z = rng.standard_normal((len(y), 2))
    part = fit_layers(z, y, seen)
    of_size = half_widths(part, z, values(y, part.slope))[:, 2]
    error = (values(y, part.slope) - true_values(seen, part.slope))[:, 2]
    assert 0.87 < (np.abs(error) <= of_size).mean() < 0.95
    assert np.median(of_size) < 0.03


PART = Layers(0.9, -0.8, ((np.log(0.2), 0.0, 0.0), (np.log(0.1), 0.0, 0.0), (np.log(0.05), 0.0, 0.0)),
              ((1.0, 1.0, 1.0),) * 3, SURE)  # fmt: skip


def answered(t_mm, d_mm, depth_mm, E_inv23=(0.3, 0.1, 0.5)):
    def spread(value):
        return value, value / 1.3, value * 1.3

    return [spread(v) for v in (60.0, t_mm, d_mm, depth_mm / d_mm)] + [E_inv23, spread(10.0)]


def test_a_reader_is_told_the_place_and_which_size_goes_with_which_stiffness():
    found = lump_layer(PART, np.zeros(1), answered(20.0, 10.0, 5.0))
    assert found.place == "in the fat" and found.odds["in the fat"] > 0.95
    assert found.in_fat == pytest.approx((1.5, 1.3, 1.7))
    assert found.depth_mm == pytest.approx((5.0, 5.0 * np.exp(-0.1), 5.0 * np.exp(0.1)))
    (soft, large), (hard, small) = found.sizes
    assert soft == pytest.approx(0.5**-1.5) and hard == pytest.approx(0.1**-1.5)
    assert large == pytest.approx(10 * np.exp(0.8 * 0.2)) and small == pytest.approx(10 * np.exp(-0.8 * 0.2))
    assert found.within == pytest.approx(np.expm1(0.05)) and found.worth_saying
    assert size_words(found.sizes, found.within) == "11.7 mm if 2.8 × fat, 8.5 mm if 32 × fat (each ± 5 %)"
    assert place_words(found.place, found.odds) == "in the fat (100 %)"


def test_between_two_layers_nothing_is_said_but_the_odds():
    found = lump_layer(PART, np.zeros(1), answered(15.0, 10.0, 5.2))
    assert found.place == "unsure"
    assert place_words(found.place, found.odds) == "unsure: in the fat 43 %, at the border 57 %"
    assert lump_layer(PART, np.zeros(1), answered(5.0, 10.0, 12.0)).place == "in the gland"
    assert lump_layer(PART, np.zeros(1), answered(10.0, 10.0, 5.0)).place == "at the border"


def test_where_the_stiffness_is_known_the_size_needs_no_other_words():
    sure = answered(20.0, 10.0, 5.0)
    sure[2] = (10.0, 9.8, 10.2)
    assert not lump_layer(PART, np.zeros(1), sure).worth_saying
    assert lump_layer(PART, np.zeros(1), [(0.0, 0.0, 0.0)] * 6) is None
