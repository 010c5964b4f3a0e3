"""What the host adds to a probe's answer, reckoned from the formulas that the model's document gives."""

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

from firmware_py import feature_names
from palpate import models
from palpate.answer import layers, words
from palpate.answer.across import across
from palpate.answer.told import told
from palpate.model_export.integers import reference
from palpate.wire.cells import COLUMN_MM
from palpate.wire.events import OUTPUTS

Q24 = 1 << 24
"""Of the features on the wire (docs/features.md)."""
T, D, H, E = (OUTPUTS.index(name) for name in ("t_mm", "d_mm", "h", "E_inv23"))


@pytest.fixture(scope="module")
def part():
    """Formulas of a model that tells layers; every layer with quantiles of its own."""
    given = models.load(models.ANYWHERE).layers
    zero = [0.0] * (len(given.spread[0]) - 2)
    spread = [[ln, *zero, by] for ln, by in ((-1.5, 0.2), (-2.5, 0.1), (-3.0, 0.05))]
    return replace(
        given, level=0.9, slope=0.4, spread=tuple(map(tuple, spread)), sure=0.8,
        quantiles=((1.0, 1.5, 2.0), (1.1, 1.6, 2.1), (1.2, 1.7, 2.2)),
    )  # fmt: skip


def lump(part, t, d, h, E_span=(0.2, 0.1, 0.3), d_span=None):
    answer = [(1.0, 0.9, 1.1)] * len(OUTPUTS)
    answer[T], answer[D], answer[H] = (t, t, t), d_span or (d, 0.9 * d, d / 0.9), (h, h, h)
    answer[E] = E_span
    return layers.lump_layer(part, np.zeros(len(part.spread[0]) - 2), answer)


@pytest.mark.parametrize(
    ("t", "d", "h", "layer"),
    [(30.0, 10.0, 1.2, 0), (17.0, 10.0, 1.2, 1), (9.0, 10.0, 0.9, 2), (8.0, 10.0, 1.4, 2)],
)
def test_layer_depth_and_size_are_the_documents_formulas(part, t, d, h, layer):
    said = lump(part, t, d, h)
    share = t / d - h
    half = [part.quantiles[k][layer] * math.exp(row[0] + row[-1] * of) for k, (row, of) in enumerate(
        zip(part.spread, (share, math.log(d * h), math.log(d) + 0.4 * 0.2)))]  # fmt: skip
    assert said.in_fat == pytest.approx((share, max(share - half[0], -1.0), min(share + half[0], 2.0)))
    depth = d * h
    assert said.depth_mm == pytest.approx((depth, depth * math.exp(-half[1]), depth * math.exp(half[1])))
    sd = half[0] / 1.6448536
    fat, gland = 1 - NormalDist(1.0, sd).cdf(2 - share), NormalDist(share, sd).cdf(0.0)
    assert list(said.odds.values()) == pytest.approx([fat, 1 - fat - gland, gland], abs=1e-6)
    likely = max(said.odds, key=said.odds.get)
    assert said.place == (likely if said.odds[likely] >= 0.8 else "unsure")
    (soft, large), (hard, small) = said.sizes
    assert (soft, hard) == pytest.approx((0.3**-1.5, 0.1**-1.5))
    assert large == pytest.approx(d * math.exp(0.4 * (0.2 - 0.3)))
    assert small == pytest.approx(d * math.exp(0.4 * (0.2 - 0.1)))
    assert said.within == pytest.approx(math.exp(half[2]) - 1) and said.level == 0.9


def test_on_the_border_of_two_layers_it_lies_in_the_one():
    assert layers.layer_of(np.array([2.0, 1.0, 0.999, 0.001, 0.0, -1.0])).tolist() == [0, 0, 1, 1, 2, 2]


def test_a_layer_that_is_just_sure_enough_is_named():
    odds = np.array([[0.8, 0.15, 0.05], [0.79, 0.2, 0.01]])
    assert layers.said(odds, 0.8).tolist() == [layers.FAT, layers.UNSURE]


def test_far_from_the_border_it_is_told_no_further_and_of_nothing_nothing_is_told(part):
    assert lump(part, 80.0, 10.0, 0.5).in_fat[0] == 2.0 and lump(part, 5.0, 10.0, 2.5).in_fat[0] == -1.0
    for t, d, h in ((0.0, 9.0, 1.0), (9.0, 0.0, 1.0), (9.0, 9.0, 0.0)):
        assert lump(part, t, d, h) is None
    nothing = [(1.0, 0.9, 1.1)] * len(OUTPUTS)
    for of in (T, D, H):
        none_of = [*nothing]
        none_of[of] = (0.0, 0.0, 3.0)
        assert layers.lump_layer(part, np.zeros(len(part.spread[0]) - 2), none_of) is None
    wide = replace(part, spread=tuple((40.0, *row[1:]) for row in part.spread))
    said = lump(wide, 17.0, 10.0, 1.2)
    assert said.in_fat[1:] == (-1.0, 2.0) and said.depth_mm[2] == pytest.approx(12 * math.exp(layers.WIDEST))


def test_a_stiffness_without_an_upper_bound_has_the_size_of_the_stiffest(part):
    said = lump(part, 17.0, 10.0, 1.2, E_span=(0.05, -0.2, 0.3))
    assert said.sizes[1] == (None, pytest.approx(10 * math.exp(0.4 * 0.05)))


def test_sizes_are_worth_saying_where_they_are_surer_than_the_diameter(part):
    within = math.log1p(lump(part, 17.0, 10.0, 1.2).within)
    for wider, worth in ((1.02, True), (0.98, False)):
        k = math.exp(wider * within)
        assert lump(part, 17.0, 10.0, 1.2, d_span=(10.0, 10 / k, 10 * k)).worth_saying == worth


@pytest.mark.parametrize("place", [-11.3, -4.75, -0.23, 0.0, 0.15, 2.36, 4.2, 12.0])
@pytest.mark.parametrize("width", [3.0, 6.0])
def test_a_bump_across_is_found_where_it_is_as_wide_as_it_is(place, width):
    """Places half a millimetre apart took it whole, and a ball near the line lay on it to the nanometre."""
    seen = across(200.0 + 3000.0 * np.exp(-((COLUMN_MM - place) ** 2) / (2 * width**2)))
    assert seen.place_mm == pytest.approx(place, abs=0.06) and seen.width_mm == pytest.approx(width, rel=0.1)
    assert seen.blur < 0.01 and seen.ln_blur == pytest.approx(math.log(0.003 + seen.blur))
    bump = np.exp(-((COLUMN_MM - place) ** 2) / (2 * width**2))
    assert seen.share == pytest.approx((200 + 3000 * bump.mean()) / 3200, rel=0.1)


def test_where_nothing_stands_out_there_is_no_place_and_all_is_blur():
    seen = across(np.full(len(COLUMN_MM), 7.0))
    assert seen.place_mm == pytest.approx(0.0, abs=1e-6) and seen.blur == 1.0
    assert across(np.full(len(COLUMN_MM), -7.0)).share == 0.0, "a share of a height is no less than none"
    noise = np.random.default_rng(4).normal(0, 1, len(COLUMN_MM))
    assert across(noise).blur > 0.3
    far = [abs(across(np.random.default_rng(k).normal(0, 1, len(COLUMN_MM))).place_mm) for k in range(40)]
    assert np.mean(far) < 4, "what is only noise lies in the middle, not where it happens to be highest"
    bump = 5 * np.exp(-((COLUMN_MM - 3) ** 2) / 18)
    clear, noisy = across(bump + 0.1 * noise), across(bump + noise)
    assert clear.blur < noisy.blur < 1 and abs(clear.place_mm - 3) < abs(noisy.place_mm - 3) + 0.5


@pytest.fixture(scope="module")
def balls():
    """A model that tells width and place across, and the integers of a stroke in its middle."""
    spec = models.load(models.BALLS)
    felt = np.zeros(len(feature_names.NAMES))
    for stage in (spec.first, spec):
        for name, value in zip(stage.features, stage.centre):
            if name in feature_names.NAMES:
                felt[feature_names.NAMES.index(name)] = value
    return spec, np.rint(felt * Q24).astype(int).tolist()


def test_width_and_place_across_are_the_documents_formulas(balls):
    spec, felt = balls
    columns = (100 + 5000 * np.exp(-((COLUMN_MM - 5.0) ** 2) / (2 * 4.0**2))).astype(int).tolist()
    said = told(spec, felt, columns).across
    bump, part = across(np.array(columns, float)), spec.across
    middle = part.place_stretch * bump.place_mm
    half = math.exp(part.place_spread[0] + part.place_spread[1] * bump.ln_blur)
    assert said.place_mm == pytest.approx((middle, middle - half, middle + half))
    assert said.level == part.level and said.place_mm[0] > 4
    x = reference.inputs(spec, np.array([felt], float) / Q24)
    x = x[:, [spec.features.index(name) for name in part.width.features]]
    y = reference.estimates(part.width, x)[0][0]
    z = (x[0] - np.array(part.width.centre)) / np.array(part.width.scale)
    half = math.exp(np.dot(part.width_spread, [1.0, *z, y]))
    assert said.width_mm == pytest.approx((math.exp(y), math.exp(y - half), math.exp(y + half)))
    as_dict = told(spec, felt, columns).as_dict()["across"]
    assert as_dict["width_mm"] == dict(zip(("value", "low", "high"), said.width_mm))


def test_the_layer_is_told_where_model_features_and_answer_are_there(balls):
    spec, (_, felt) = models.load(models.ANYWHERE), balls
    answer = [(1.0, 0.9, 1.1)] * len(OUTPUTS)
    answer[T], answer[D], answer[H], answer[E] = (17.0,) * 3, (10.0,) * 3, (1.2,) * 3, (0.2, 0.1, 0.3)
    said = told(spec, felt, None, answer).layer
    x = reference.inputs(spec, np.array([felt], float) / Q24)
    (z,) = reference.standardised(spec, x)
    assert said == layers.lump_layer(spec.layers, z, answer) and said.depth_mm[0] == pytest.approx(12.0)
    assert said.odds != dict.fromkeys(said.odds, said.odds["in the fat"])
    assert told(spec, None, None, answer).layer is None and told(spec, felt, None).layer is None
    assert told(balls[0], felt, None, answer).layer is None, "a model on the border tells none"
    outside = told(spec, [1 << 22] * len(felt), None, answer, in_domain=False)
    assert outside.outside and outside.as_dict()["outside"] == list(outside.outside)
    assert outside.as_dict()["layer"]["place"] == outside.layer.place and outside.as_dict()["across"] is None


def test_what_did_not_come_is_not_made_up(balls):
    spec, felt = balls
    flat = [50] * len(COLUMN_MM)
    assert (
        told(spec, felt, None).across.place_mm is None and told(spec, felt, [0] * 26).across.place_mm is None
    )
    assert told(spec, None, flat).across.width_mm is None and told(spec, None, flat).across.place_mm
    known = {*spec.features, *spec.first.features} & {*feature_names.NAMES}
    enough = 1 + max(feature_names.NAMES.index(name) for name in known)
    assert told(spec, felt[:enough], flat) == told(spec, felt, flat)
    assert told(spec, felt[: enough - 1], flat).across.width_mm is None, "an older firmware knows fewer"
    none = told(models.load(models.FIELD), felt, flat)
    assert none.across is None and none.layer is None and none.outside == ()
    assert told(spec, [1 << 29] * len(felt), flat) is not None, "numbers that no stroke gives"
    assert not told(spec, felt, flat, in_domain=True).outside


def test_places_sizes_and_stiffness_in_words():
    odds = {"in the fat": 0.93, "at the border": 0.06, "in the gland": 0.01}
    assert words.place_words("in the fat", odds) == "in the fat (93 %)"
    assert words.place_words("unsure", odds) == "unsure: in the fat 93 %, at the border 6 %"
    edge = {"in the fat": 0.9, "at the border": 0.05, "in the gland": 0.049}
    assert words.place_words("unsure", edge).endswith("at the border 5 %")
    sizes = ((3.14, 13.44), (12.4, 10.06))
    assert words.size_words(sizes, 0.066) == "13.4 mm if 3.1 × fat, 10.1 mm if 12 × fat (each ± 7 %)"
    assert words.size_words(((None, 9.0),), 0.1) == "9.0 mm if over 50 × fat (each ± 10 %)"
    assert words.size_words(((2.0, 9.0),), 0.77).endswith("(each ± 77 %)")
    assert words.stiffness_words((0.3, 0.001, 0.4)) == "over 4 × fat"
    assert words.stiffness_words((0.0, -0.1, 0.0), (10.0, 8.0, 12.0)) == "over 1 × fat, over 10 kPa"
    both = words.outside_words(["d_mm", "h", "two_lumps", "thin_air"])
    assert both.count(";") == 2 and "would lie beyond" in both and both.endswith("it looks like thin air")
