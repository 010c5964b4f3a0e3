"""The model that was told its tissue notices another by the press, and leaves its own strokes alone."""

from __future__ import annotations

import pytest

from palpate import models
from palpate.dataset.answers import shows_lump
from palpate.features.press_features import PLACES
from palpate.learn import data
from palpate.learn.observed import joined, observe_in_any_fat, own_fat
from palpate.model_export.integers import force_map
from palpate.model_export.integers.reference import checks_of, evaluate, inputs
from palpate.model_export.vocabulary import ABSENT
from tests.host.learn.conftest import STROKES

LUMPS = 32


@pytest.fixture(scope="module")
def spec():
    return models.load(models.TOLD)


@pytest.fixture(scope="module")
def lumps():
    """Strokes over lumps that the model has not met, and the presses before them."""
    return data.read_strokes(STROKES).lumps[:LUMPS]


def seen(spec, lumps, fat):
    """The firmware's features of two strokes over each lump, with fat and force times this."""
    blob, fat_kPa = force_map.blob(spec.force_map), [fat * own for own in own_fat(lumps)]
    X = joined([observe_in_any_fat(lumps, "typical", seed, blob, fat_kPa=fat_kPa) for seed in (31, 32)])
    return X.X[X.whole & shows_lump(spec, X.X)]


def flagged(spec, X):
    return ~evaluate(spec, inputs(spec, X))["in_domain"]


@pytest.mark.parametrize("fat", [0.7, 1.3])
def test_fat_thirty_percent_off_is_flagged(spec, lumps, fat):
    """Softer fat over a lump gives very nearly the stroke of a larger lump; the press tells them apart."""
    X = seen(spec, lumps, fat)
    assert len(X) > 40
    assert flagged(spec, X).mean() >= 0.95


def test_its_own_strokes_are_left_alone_by_the_checks(spec, lumps):
    X = seen(spec, lumps, 1.0)
    assert (checks_of(spec, inputs(spec, X)) > 0).any(axis=1).mean() <= 0.05


def test_a_stroke_that_begins_pressed_raises_no_alarm_of_the_press(spec, lumps):
    X = seen(spec, lumps, 1.0)
    bare = X.copy()
    bare[:, PLACES] = ABSENT
    assert (checks_of(spec, inputs(spec, bare))[:, 1:] == 0).all()
    assert not (flagged(spec, bare) & ~flagged(spec, X)).any()
