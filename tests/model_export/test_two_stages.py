"""A model whose second stage takes what its first makes of other features: one image, one answer."""

from __future__ import annotations

import dataclasses
from array import array
from itertools import combinations_with_replacement

import numpy as np
import pytest

from firmware_py import evaluator, feature_names, features, model_check, stage, status
from firmware_py import model_image as fw
from palpate.model_export import image_builder
from palpate.model_export.errors import ModelError, ProofError
from palpate.model_export.exporter import export
from palpate.model_export.integers import bounds, compiler, reference
from palpate.model_export.schema import Estimate, FirstStage, ModelSpec
from tests.micropython import run_micropython
from tests.model_export import synthetic
from tests.model_export.flashing import body_of

Q24 = 1 << 24
PRESS = feature_names.NAMES[features.PRESS : features.PRESS + 9]


def two_stages():
    """The made-up field model; its last three features come of a made-up cubic of nine others."""
    terms, rng = 120, np.random.default_rng(1)
    field = synthetic.model("field")
    names = ("ln_reach", "ln_t", "ln_layers")
    every = [t for p in range(4) for t in combinations_with_replacement(range(9), p)]
    chosen = (*every[:10], *sorted(tuple(every[k]) for k in rng.choice(range(10, 220), terms - 10, False)))
    estimates = []
    for j, name in enumerate(names):
        i = len(field.features) - 3 + j
        size = (field.domain.hi[i] - field.domain.lo[i]) / 8
        values = rng.normal(0, size, terms) / np.array([4.0 ** max(len(t) - 1, 0) for t in chosen])
        values[0] = field.centre[i]
        estimates.append(Estimate(name, field.clip_lo[i], field.clip_hi[i], tuple(values.tolist())))
    centre = tuple(np.linspace(-1, 2, 9).tolist())
    scale = tuple(np.linspace(0.1, 0.4, 9).tolist())
    lo, hi = (tuple((np.array(centre) + s * np.array(scale)).tolist()) for s in (-3.0, 3.0))
    first = FirstStage(PRESS, centre, scale, lo, hi, chosen, tuple(estimates))
    return dataclasses.replace(
        field, features=(*field.features[:-3], *names), first=first, features_version=2
    ).validate()


@pytest.fixture(scope="module")
def spec():
    return two_stages()


@pytest.fixture(scope="module")
def body(spec):
    return body_of(spec)


def loaded(body):
    code, model = fw.load(
        lambda at, n: body[at : at + n], len(body), features.FEATURES_VERSION, features.COUNT
    )
    if code == status.OK:
        code = fw.self_test(model, lambda at, n: body[at : at + n], features.COUNT)
    return code, model


def vectors(spec, n, seed=5):
    """All of the firmware's features, n of them, about where the model was made up; whole Q24 numbers."""
    rng = np.random.default_rng(seed)
    X = rng.normal(0, 1, (n, features.COUNT))
    for part in (spec, spec.first):
        for i, name in enumerate(part.features):
            if name in feature_names.NAMES:
                spread = rng.normal(0, 0.8, n).clip(-3, 3)
                X[:, feature_names.NAMES.index(name)] = part.centre[i] + spread * part.scale[i]
    return np.round(X * Q24) / Q24


def answers(model, rows):
    """Status and integers that a model gives for rows of features in integers."""
    out = array("i", [0] * evaluator.OUT_SIZE)
    return [[model.evaluate(array("i", row), out), *out] for row in rows]


def said(model, X):
    return np.array(answers(model, np.round(X * Q24).astype(int).tolist()))


def test_the_integers_of_both_stages_are_those_of_float64(spec, body):
    X = vectors(spec, 1000)
    first = compiler.compile_first(spec.first)
    own = X[:, [feature_names.NAMES.index(name) for name in PRESS]]
    wanted = reference.estimates(spec.first, own)
    got = [list(first.extend(array("i", row)))[features.COUNT :] for row in (X * Q24).astype(int).tolist()]
    assert np.array(got) / Q24 == pytest.approx(wanted, abs=1e-4)
    code, model = loaded(body)
    assert code == status.OK
    limits = dataclasses.replace(spec, lump=())
    answers, want = said(model, X), reference.evaluate(limits, reference.inputs(spec, X))
    found = answers[:, 0] == status.OK
    assert found.sum() > 300
    for j in range(4):
        got = answers[found, 1 + 3 * j] / 1e6
        assert got == pytest.approx(want["value"][found, j], rel=5e-4), j
    assert ((answers[found, 1 + evaluator.FLAGS] & 2 > 0) == want["in_domain"][found]).mean() > 0.99


def test_a_press_that_is_absent_is_outside_the_domain(spec, body):
    _, model = loaded(body)
    X = vectors(spec, 400)
    X[:, features.PRESS : features.PRESS + 9] = features.ABSENT / Q24
    narrow = dataclasses.replace(
        spec,
        domain=dataclasses.replace(spec.domain, lo=tuple(c - 3 * s for c, s in zip(spec.centre, spec.scale))),
    )
    assert narrow.domain.lo != spec.domain.lo
    first = reference.estimates(spec.first, X[:1, features.PRESS : features.PRESS + 9])
    inside = (said(model, X)[:, 1 + evaluator.FLAGS] & 2 > 0).mean()
    ends = [(e.lo, e.hi) for e in spec.first.estimates]
    if any(v in end for v, end in zip(first[0], ends)):
        assert inside == 0


def test_both_stages_are_proved_and_coefficients_without_room_are_refused(spec):
    proof = bounds.prove_first(compiler.compile_first(spec.first))
    assert 2**20 < proof.largest < 2**30
    huge = dataclasses.replace(spec.first.estimates[0], coefficients=(1e9,) * len(spec.first.terms))
    first = dataclasses.replace(spec.first, estimates=(huge, *spec.first.estimates[1:]))
    with pytest.raises(ProofError):
        bounds.prove_first(compiler.compile_first(first))


def test_an_image_of_both_stages_keeps_under_9_kB_and_is_itself_after_a_round_trip(spec, key_dir, tmp_path):
    data, report = export(spec, key_dir)
    assert report.size < 9000 + report.signature_size
    info = image_builder.inspect(data)
    assert info.features == spec.features and info.features_version == 2
    direct = stage.Staged(compiler.compile_first(spec.first), compiler.compile_model(spec))
    X = vectors(spec, 200)
    assert np.array_equal(said(info.model, X), said(direct, X))
    spec.save(tmp_path / "model.json")
    assert ModelSpec.load(tmp_path / "model.json") == spec


def test_models_of_one_stage_are_written_as_before(field):
    assert "first" not in field.to_dict()
    body = body_of(field)
    assert body[102:104] == bytes(2)


def noticed_flips(body, section, X, count, seed):
    """How many of so many bits flipped in a section are noticed; with the others no answer leaves +-2^30."""
    rng = np.random.default_rng(seed)
    header = fw.Header(lambda at, n: body[at : at + n], len(body))
    at, size = header.places[section]
    noticed = 0
    for k in rng.choice(size, count, replace=False):
        other = bytearray(body)
        other[at + k] ^= 1 << int(rng.integers(8))
        code, model = loaded(bytes(other))
        noticed += code != status.OK
        if model is not None:
            assert (np.abs(said(model, X)) < 2**30).all()
    return noticed


def test_a_changed_bit_of_the_first_stage_is_noticed_or_small(spec, body):
    noticed = noticed_flips(body, fw.FIRST_STAGE, vectors(spec, 3), 150, seed=2)
    assert noticed > 75, "what is not noticed is padding, or a coefficient that its vector hardly meets"


def test_a_second_stage_cannot_ask_for_a_value_that_the_first_does_not_give(spec, body):
    header = fw.Header(lambda at, n: body[at : at + n], len(body))
    other = bytearray(body)
    other[header.places[fw.IDS][0] + len(spec.features) - 1] = model_check.FIRST_ID + 3
    assert loaded(bytes(other))[0] == status.MISSING_FEATURE
    other = body[: header.places[fw.FIRST_STAGE][0]]
    other = other[:8] + len(other).to_bytes(4, "little") + other[12:102] + bytes(2) + other[104:]
    assert loaded(other)[0] == status.MISSING_FEATURE


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"estimates": ()}, "1 to 3"),
        ({"terms": ((0, 0, 0, 0),)}, "degree 4"),
        ({"features": PRESS[:3]}, "clip|scale|centre"),
    ],
)
def test_what_cannot_be_a_first_stage_is_said(spec, change, words):
    with pytest.raises(ModelError, match=words):
        dataclasses.replace(spec, first=dataclasses.replace(spec.first, **change)).validate()


def test_a_name_of_the_firmwares_own_is_refused(spec):
    taken = dataclasses.replace(spec.first.estimates[0], name="ln_d0")
    first = dataclasses.replace(spec.first, estimates=(taken, *spec.first.estimates[1:]))
    with pytest.raises(ModelError, match="ln_d0"):
        compiler.compile_first(first)


SCRIPT = """
import micropython, struct
from array import array
from firmware_py import evaluator, features, model_image
body = open("image", "rb").read()
read = lambda at, n: body[at:at + n]
code, model = model_image.load(read, len(body), features.FEATURES_VERSION, features.COUNT)
assert code == 0 and model_image.self_test(model, read, features.COUNT) == 0
out = array("i", bytes(4 * evaluator.OUT_SIZE))
def run(x):
    micropython.heap_lock()
    code = model.evaluate(x, out)
    micropython.heap_unlock()
    return code
form = "<%di" % features.COUNT
with open("vectors", "rb") as f:
    while raw := f.read(4 * features.COUNT):
        print(run(array("i", struct.unpack(form, raw))), *out)
"""


def alike_on_micropython(body, X):
    """What an image's model answers, here and on MicroPython, where nothing is allocated for it."""
    told = run_micropython(SCRIPT, {"image": body, "vectors": np.round(X * Q24).astype("<i4").tobytes()})
    _, model = loaded(body)
    here = said(model, X).tolist()
    assert [[int(v) for v in line.split()] for line in told.splitlines()] == here
    return here


def test_on_micropython_the_same_integers_and_not_one_byte_allocated(spec, body):
    alike_on_micropython(body, vectors(spec, 40))
