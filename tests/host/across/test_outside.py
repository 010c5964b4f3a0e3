"""Why a model is not for a stroke: said live, from a recording and on the card."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

from palpate import models
from palpate.answer.outside import why_outside
from palpate.answer.words import outside_words
from palpate.model_export.integers import reference
from palpate.model_export.vocabulary import ABSENT, OF_THE_PRESS, WORDS
from palpate.sim.probe.noise import LEVELS
from palpate.sim.probe.over_lump import strokes_over
from palpate.stroke.read import load_strokes
from palpate.stroke.replay import replay
from tests.host.across.test_across import streamed
from tests.host.conftest import emulated

__all__ = ["emulated"]

TOO_LARGE, ORDINARY = "d25h04e100f05", "d12h08e10f05"


def asked(palpate, emulated, tmp_path, code, noise="typical", press=True):
    streams, calibration = strokes_over(code, noise, 1, 60, 1, press=press)
    ((stroke,), visit) = streamed(palpate, emulated, tmp_path, streams, calibration, models.FIELD)
    return stroke, visit


@pytest.mark.timeout(300)
def test_a_lump_beyond_the_ranges_is_said_to_be_live_replayed_and_on_the_card(palpate, emulated, tmp_path):
    stroke, visit = asked(palpate, emulated, tmp_path, TOO_LARGE)
    assert not stroke["in_domain"] and stroke["outside"][0] == "d_mm"
    (again,) = replay(visit)
    assert again.identical and again.as_dict()["outside"] == stroke["outside"]
    words = f"{WORDS['d_mm']} would lie beyond what the model knows"
    status, out, _ = palpate("replay", visit)
    assert status == 0 and words in out
    (shown,) = load_strokes(visit)
    assert words in shown.summary()["card"]["text"]


@pytest.mark.timeout(300)
def test_a_stroke_without_its_press_is_said_to_lack_it(palpate, emulated, tmp_path):
    stroke, _ = asked(palpate, emulated, tmp_path, ORDINARY, press=False)
    assert not stroke["in_domain"] and stroke["outside"] == ["no_press"]


@pytest.mark.timeout(300)
def test_undulating_tissue_is_named_and_of_an_ordinary_stroke_nothing_is_said(palpate, emulated, tmp_path):
    sensor = tmp_path / "sensor.toml"
    typical = {name: value for name, value in asdict(LEVELS["typical"]).items() if name != "quantise"}
    numbers = {**typical, "undulation": 0.1}
    sensor.write_text("[noise]\n" + "".join(f"{name} = {value}\n" for name, value in numbers.items()))
    stroke, _ = asked(palpate, emulated, tmp_path, ORDINARY, str(sensor))
    assert not stroke["in_domain"] and "uneven_tissue" in stroke["outside"]
    (tmp_path / "visit.mcap").unlink()
    stroke, _ = asked(palpate, emulated, tmp_path, ORDINARY)
    assert stroke["in_domain"] and stroke["outside"] == []


def test_every_check_of_the_models_that_come_with_palpate_has_words_of_its_own():
    for name in models.NAMES:
        checks = models.load(name).checks
        for check in () if checks is None else checks.estimates:
            assert "looks like" not in outside_words([check.name]), check.name
    assert outside_words(["thick_skin"]) == "it looks like thick skin" and not outside_words([])


def test_a_feature_of_the_press_that_is_absent_is_the_only_reason():
    """Whatever else is beyond its range then is so because of it."""
    spec, stroke = models.load(models.FIELD), models.recipe(models.FIELD)["sample"][0]
    there = np.array([[stroke["features"][name] for name in spec.features]])
    for k, name in enumerate(spec.features):
        x = there.copy()
        x[0, k] = ABSENT
        why = why_outside(spec, x)
        assert (why == ("no_press",)) == (name in OF_THE_PRESS) and why
    x = there * 3
    beyond = why_outside(spec, x)
    assert {"d_mm", "t_mm"} & set(beyond) and {check.name for check in spec.checks.estimates} & set(beyond)


def test_what_is_flagged_has_a_reason_and_what_is_not_has_none():
    """Strokes round one of the training's, near and far: some are outside by their distance alone."""
    spec, stroke = models.load(models.FIELD), models.recipe(models.FIELD)["sample"][0]
    there = np.array([[stroke["features"][name] for name in spec.features]])
    rng = np.random.default_rng(0)
    reasons = set()
    for _ in range(200):
        x = there + rng.normal(0, rng.choice([0.01, 0.05, 0.2, 1.0]), there.shape)
        why = why_outside(spec, x)
        assert bool(why) != bool(reference.evaluate(spec, x)["in_domain"][0]), why
        reasons |= set(why)
    assert {"unfamiliar", "uneven_tissue", "d_mm"} <= reasons
