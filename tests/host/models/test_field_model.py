"""The models that come with Palpate are those that their recipes describe, and still say what they said."""

from __future__ import annotations

import pytest

from palpate import models
from palpate.learn.probe_model import features_version
from palpate.models.build import MADE, sample
from palpate.wire.events import OUTPUTS
from tests.studies.coverage import NAMES, coverage

# A gain of all cells that is off, in one sample by three times its spread, goes into F and E_fat.
NEAR = {
    models.FIELD: {"F_N_per_m": 0.08, "t_mm": 0.08, "d_mm": 0.15, "h": 0.2, "E_fat_kPa": 0.12},
    models.BALLS: {"F_N_per_m": 0.08, "t_mm": 0.17, "d_mm": 0.2, "h": 0.25, "E_fat_kPa": 0.16},
    models.ANYWHERE: {"F_N_per_m": 0.08, "t_mm": 0.1, "d_mm": 0.3, "h": 0.6, "E_fat_kPa": 0.16},
    models.TOLD: {"F_N_per_m": 0.08, "t_mm": 0.06, "d_mm": 0.06, "h": 0.1, "E_fat_kPa": 1e-6},
}
SINCE = {"tilt_20_24": 1, "base_share": 2, "press_outer_full": 3, "lift_17_22": 4, "across_3_5": 5}
each = pytest.mark.parametrize("name", models.NAMES)


@each
def test_the_file_is_the_one_that_the_recipe_was_written_for(name):
    recipe = models.recipe(name)
    assert recipe["sha256"] == models.file_hash(models.path(name))
    assert recipe["made"] == MADE[name]
    assert recipe["training"] == models.load(name).training["hash"]


QUICK = [name for name in models.NAMES if name != models.BALLS]


@pytest.mark.parametrize("name", [*QUICK, pytest.param(models.BALLS, marks=pytest.mark.long)])
def test_a_sample_simulated_and_observed_anew_gets_the_same_answers(name):
    """Solid lumps take twenty seconds; tests/sim/tissue/test_kept_balls.py simulates two in `make test`."""
    for kept, now in zip(models.recipe(name)["sample"], sample(name, models.load(name)), strict=True):
        assert now["code"] == kept["code"]
        assert now["features"] == pytest.approx(kept["features"], rel=2e-3, abs=2e-3)
        for output in OUTPUTS:
            assert now[output] == pytest.approx(kept[output], rel=0.01, abs=0.005), (kept["code"], output)


@each
def test_its_answers_are_near_the_truth(name):
    for stroke in models.recipe(name)["sample"]:
        for output, share in NEAR[name].items():
            assert stroke[output]["value"] == pytest.approx(stroke[output]["truth"], rel=share), stroke[
                "code"
            ]


@each
def test_its_intervals_hold_the_truth(name):
    """All but one in ten: a lump anywhere may be large and soft or small and hard, and only they tell."""
    strokes = models.recipe(name)["sample"]
    held = [s[o]["low"] - 1e-6 <= s[o]["truth"] <= s[o]["high"] + 1e-6 for s in strokes for o in OUTPUTS]
    assert sum(held) >= 0.9 * len(held)


def test_each_asks_for_no_newer_probe_than_its_features_need():
    wanted = {name: models.load(name).features_version for name in models.NAMES}
    assert wanted == {models.FIELD: 4, models.BALLS: 5, models.ANYWHERE: 4, models.TOLD: 2}


@pytest.mark.parametrize(("newest", "version"), SINCE.items())
def test_a_model_fitted_now_asks_for_no_newer_one_either(newest, version):
    """Whatever was not the oldest asked for the newest, once a fifth version came."""
    assert features_version(["ln_base", newest]) == version


def test_only_the_one_that_was_told_its_tissue_does_without_the_press():
    without = [name for name in models.NAMES if models.load(name).first is None]
    assert without == [models.TOLD]


@pytest.mark.long
def test_intervals_hold_on_lumps_that_were_never_met_the_depths_among_them(tmp_path):
    """Were t and d taken as independent, the depth's 90 % would be 96."""
    shares, lost = coverage(tmp_path, 256)
    whole = shares.loc["all"]
    assert 20 < lost < 60
    for name in (*NAMES, "depth"):
        assert 0.86 <= whole[name] <= 0.95, name
    assert whole["independent"] > 0.93
