"""The bundled model is the one that its recipe describes, and still says what it said."""

from __future__ import annotations

import pytest

from palpate import models
from palpate.link.events import OUTPUTS
from palpate.models.build import MADE, sample
from palpate.models.coverage import coverage


def test_the_file_is_the_one_that_the_recipe_was_written_for():
    recipe = models.recipe()
    assert recipe["sha256"] == models.file_hash()
    assert recipe["made"] == MADE
    assert recipe["training"] == models.load().training


def test_a_sample_simulated_and_observed_anew_gets_the_same_answers():
    for kept, now in zip(models.recipe()["sample"], sample(models.load()), strict=True):
        assert now["code"] == kept["code"]
        assert now["features"] == pytest.approx(kept["features"], rel=2e-3, abs=2e-3)
        for name in OUTPUTS:
            assert now[name] == pytest.approx(kept[name], rel=0.01, abs=0.005), (kept["code"], name)


def test_its_answers_are_near_the_truth():
    for stroke in models.recipe()["sample"]:
        for name, share in (("F_N_per_m", 0.04), ("t_mm", 0.04), ("d_mm", 0.06), ("h", 0.1)):
            assert stroke[name]["value"] == pytest.approx(stroke[name]["truth"], rel=share), stroke["code"]


@pytest.mark.long
def test_its_intervals_hold_on_lumps_that_it_never_met_the_depths_among_them():
    """Were t and d taken as independent, the depth's 90 % would be 96."""
    shares, lost = coverage(256)
    whole = shares.loc["all"]
    assert 20 < lost < 60
    for name in (*OUTPUTS, "depth"):
        assert 0.86 <= whole[name] <= 0.95, name
    assert whole["independent"] > 0.93
