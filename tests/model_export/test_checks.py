"""A model's checks: polynomials of its own features, or the press's, that say what a stroke is unlike."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from firmware_py import evaluator, feature_names, outputs, status
from firmware_py import model_image as fw
from palpate.learn.checks import joined
from palpate.model_export import image_builder
from palpate.model_export.errors import ModelError, ProofError
from palpate.model_export.exporter import export, prepare
from palpate.model_export.integers import bounds, compiler, reference
from palpate.model_export.schema import Estimate, FirstStage, ModelSpec
from palpate.model_export.vocabulary import ABSENT, OF_THE_PRESS
from tests.model_export import synthetic
from tests.model_export.flashing import body_of
from tests.model_export.test_two_stages import (
    alike_on_micropython,
    loaded,
    noticed_flips,
    said,
    two_stages,
    vectors,
)

WIDE = FirstStage(
    ("press_outer_quarter", "press_outer_full"),
    (1.0, 1.0),
    (0.4, 0.4),
    (-0.5, -0.5),
    (2.5, 2.5),
    ((), (0,), (1,), (0, 1)),
    (Estimate("wide", -1.0, 1.0, (-0.02, -0.06, 0.09, 0.03)),),
)
"""A check of the press alone."""


def with_checks(spec: ModelSpec) -> ModelSpec:
    """The model with two made-up checks of its last six features, each over 0 in a fair share of strokes."""
    at = range(len(spec.features) - 6, len(spec.features))
    part = {
        name: tuple(getattr(spec, name)[i] for i in at)
        for name in ("features", "centre", "scale", "clip_lo", "clip_hi")
    }
    terms = ((), *((i,) for i in range(6)), (0, 0), (1, 4), (2, 5), (3, 3, 5))
    rng = np.random.default_rng(4)
    checks = []
    for name in ("two_lumps", "other_tissue"):
        values = rng.normal(0, 0.05, len(terms))
        values[0] = -0.05
        checks.append(Estimate(name, -1.0, 1.0, tuple(values.tolist())))
    return dataclasses.replace(
        spec, checks=FirstStage(**part, terms=terms, estimates=tuple(checks))
    ).validate()


@pytest.fixture(scope="module", params=["one stage", "two stages"])
def spec(request):
    plain = synthetic.model("field") if request.param == "one stage" else two_stages()
    return with_checks(plain)


@pytest.fixture(scope="module")
def body(spec):
    return body_of(spec)


def some(spec, n=600):
    if spec.first is not None:
        return vectors(spec, n)
    return vectors(dataclasses.replace(spec, first=FirstStage((), (), (), (), (), (), ())), n)


def test_a_stroke_where_a_check_is_above_zero_is_outside_and_its_numbers_stay(spec, body):
    X = some(spec, 2000)
    code, model = loaded(body)
    assert code == status.OK
    _, plain = loaded(body_of(dataclasses.replace(spec, checks=None)))
    got, without = said(model, X), said(plain, X)
    flags = 1 + evaluator.FLAGS
    assert np.array_equal(np.delete(got, flags, 1), np.delete(without, flags, 1))
    inside, was = (rows[:, flags] & outputs.IN_DOMAIN > 0 for rows in (got, without))
    values = reference.checks_of(spec, reference.inputs(spec, X))
    clear = np.abs(values).min(axis=1) > 1e-4
    fails = (values > 0).any(axis=1)
    assert fails[clear & was].sum() > 20 and (~fails)[clear & was].sum() > 20
    assert np.array_equal(inside[clear], (was & ~fails)[clear])
    told = reference.evaluate(spec, reference.inputs(spec, X))
    assert np.array_equal(told["unlike"].any(axis=1), fails)
    assert not (told["in_domain"] & fails).any()


@pytest.fixture(scope="module")
def by_press(spec):
    """The same with a third check, of how much of the press reaches the outer columns."""
    return dataclasses.replace(spec, checks=joined(spec.checks, WIDE), features_version=3).validate()


def pressed(spec, n=600):
    """The firmware's features of strokes with a press before them; the first half of them without."""
    X = some(spec, n)
    rng = np.random.default_rng(4)
    for name in WIDE.features:
        X[:, feature_names.NAMES.index(name)] = np.round(rng.normal(1.0, 0.4, n) * 2**16) / 2**16
    X[: n // 2, [feature_names.NAMES.index(name) for name in OF_THE_PRESS]] = ABSENT
    return X


def test_checks_of_the_press_say_nothing_where_there_was_none(by_press):
    """Absent features would be a press at the end of its clip box, and every stroke without one strange."""
    body = body_of(by_press)
    code, model = loaded(body)
    assert code == status.OK
    X = pressed(by_press, 4000)
    values = reference.checks_of(by_press, reference.inputs(by_press, X))
    assert (values[:2000, 2] == 0).all() and 200 < (values[2000:, 2] > 0).sum() < 1800
    assert (values[:2000, :2] > 0).any(axis=1).sum() > 200, "those of the stroke go on"
    without = dataclasses.replace(by_press, checks=None)
    _, plain = loaded(body_of(without))
    flags = 1 + evaluator.FLAGS
    inside, was = (said(m, X)[:, flags] & outputs.IN_DOMAIN > 0 for m in (model, plain))
    assert (was & inside)[2000:].sum() > 10 < (was & ~inside)[2000:].sum()
    clear = np.where(values == 0, 1.0, np.abs(values)).min(axis=1) > 1e-3
    assert np.array_equal(inside[clear], (was & ~(values > 0).any(axis=1))[clear])


def test_the_models_own_features_are_those_of_a_stroke_without_a_press(by_press):
    X = pressed(by_press, 400)
    X[:, [feature_names.NAMES.index(name) for name in OF_THE_PRESS]] = ABSENT
    inputs = reference.inputs(by_press, X)
    own = reference.evaluate(by_press, inputs[:, : len(by_press.features)])
    assert np.array_equal(reference.evaluate(by_press, inputs)["unlike"], own["unlike"])


def test_checks_are_proved_with_the_rest_and_coefficients_without_room_are_refused(spec):
    _, proof, _ = prepare(spec)
    assert proof.largest >= bounds.prove_first(compiler.compile_checks(spec)).largest
    huge = dataclasses.replace(spec.checks.estimates[0], coefficients=(1e9,) * len(spec.checks.terms))
    checks = dataclasses.replace(spec.checks, estimates=(huge,))
    with pytest.raises(ProofError):
        prepare(dataclasses.replace(spec, checks=checks))


def test_checks_go_through_file_and_signed_image(spec, key_dir, tmp_path):
    spec.save(tmp_path / "model.json")
    assert ModelSpec.load(tmp_path / "model.json") == spec
    data, _ = export(spec, key_dir)
    info = image_builder.inspect(data)
    _, model = loaded(body_of(spec))
    X = some(spec, 100)
    assert np.array_equal(said(info.model, X), said(model, X))


def test_a_firmware_that_knows_nothing_of_checks_refuses_the_image(body):
    """It wants zeros where their length stands."""
    header = fw.Header(lambda at, n: body[at : at + n], len(body))
    assert int.from_bytes(body[20:24], "little") == header.places[fw.CHECKS][1] > 0
    without = body[:20] + bytes(4) + body[24:]
    assert loaded(without)[0] == status.BAD_LENGTH


def test_a_changed_check_is_noticed_or_small(spec, body):
    noticed = noticed_flips(body, fw.CHECKS, some(spec, 3), 100, seed=3)
    assert noticed > 40, "what is not noticed is padding, or a coefficient that its vector hardly meets"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"features": ("ln_d0", "ln_amp", "ln_base", "tilt_3_5", "dip_3_5", "ln_stdev")},
            "none of the model's",
        ),
        ({"estimates": (Estimate("two_lumps", 0.0, 1.0, (0.1,) * 11),)}, "both sides of 0"),
        ({"estimates": ()}, "1 to 3"),
        ({"terms": ((9,),)}, "checks.terms"),
    ],
)
def test_what_cannot_be_a_check_is_said(spec, change, words):
    with pytest.raises(ModelError, match=words):
        dataclasses.replace(spec, checks=dataclasses.replace(spec.checks, **change)).validate()


def test_on_micropython_the_same_answers_and_not_one_byte_allocated(spec, body):
    alike_on_micropython(body, some(spec, 40))


def test_on_micropython_the_same_without_a_press(by_press):
    body = body_of(by_press)
    alike_on_micropython(body, pressed(by_press, 40))
