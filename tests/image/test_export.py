"""`export`: sizes, the report, and what it refuses before anything is signed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from firmware_py import features as firmware_features
from firmware_py import forcemap
from model_export import compiler, image, keys, lms_sign
from model_export.errors import ExportError, ImageError, ModelError
from model_export.exporter import export
from tests.image import synthetic


@pytest.fixture(scope="module")
def default_key(tmp_path_factory):
    """A key of the default sizes, all but its height: as long a signature as height 10 less five nodes."""
    directory = tmp_path_factory.mktemp("default") / "key"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PALPATE_STATE", str(tmp_path_factory.getbasetemp() / "state"))
        keys.generate(directory, height=5)
    return directory


FIVE_MORE_NODES = 5 * 24


def a_force_map():
    rng = np.random.default_rng(4)
    return {
        "version": forcemap.VERSION,
        "even": rng.normal(0, 0.1, (14, 9)).tolist(),
        "odd": rng.normal(0, 0.1, (8, 8)).tolist(),
        "ln_F": 4.0,
        "ln_D": 1.0,
        "rms": 0.01,
    }


def test_a_field_model_with_force_map_and_intervals_is_under_8_kB_and_a_thesis_model_under_3_kB(
    field, thesis, default_key
):
    data, report = export(dataclasses.replace(field, force_map=a_force_map()), default_key)
    assert image.inspect(data).model.force_map is not None
    assert report.size == len(data) and len(data) + FIVE_MORE_NODES < 8000
    data, _ = export(thesis, default_key)
    assert len(data) + FIVE_MORE_NODES < 3000


def test_the_report_measures_over_the_training_set_if_the_model_brings_it(thesis, default_key):
    _, report = export(thesis, default_key)
    assert report.over == "random vectors of the domain" and report.errors.n == 2000
    rows = np.random.default_rng(1).uniform(thesis.clip_lo, thesis.clip_hi, (29, 6)).tolist()
    trained = dataclasses.replace(thesis, training={**thesis.training, "features": rows})
    _, report = export(trained, default_key)
    assert report.over == "the training set" and report.errors.n == 29
    assert max(report.errors.worst.values()) < 5e-5
    assert report.proof.largest < 2**30
    assert any("worst error" in line for line in report.lines())
    assert report.to_dict()["errors"]["n"] == 29


def test_the_counter_rises_with_every_export_and_a_rollback_says_how_far(thesis, default_key):
    first = export(thesis, default_key)[1]
    second = export(thesis, default_key)[1]
    assert second.counter == first.counter + 1 and second.replaces == 0
    back = export(thesis, default_key, counter=1, rollback=True)[1]
    assert back.counter == 1 and back.replaces >= second.counter


def test_an_image_says_what_it_is(field, default_key):
    data, report = export(field, default_key)
    info = image.inspect(data, (default_key / "public.key").read_bytes())
    assert (info.kind, info.features, info.signature) == ("field", field.features, "good")
    assert info.model_id == report.model_id and info.training == field.training["hash"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"features": ("ln_base", "ln_amp", "ln_stdev", "inv_curvature", "ln_d28", "no_such")}, "no_such"),
        ({"features_version": 77}, "version 77"),
        ({"force_map": {"version": 99}}, "force map"),
        ({"lump": (synthetic.Limit("ln_d0", lo=30.9, hi=31.0),)}, "nothing in common"),
    ],
)
def test_what_cannot_be_exported_is_named_and_costs_no_signature(thesis, default_key, change, words):
    before = keys.load(default_key).used
    with pytest.raises(ExportError, match=words):
        export(dataclasses.replace(thesis, **change), default_key)
    assert keys.load(default_key).used == before


def test_a_precision_that_is_no_metric_is_refused(thesis, default_key):
    flat = dataclasses.replace(thesis.domain, precision=((0.0,) * 6,) * 6)
    with pytest.raises(ModelError, match="positive definite"):
        export(dataclasses.replace(thesis, domain=flat), default_key)


def signed_body(spec):
    secret = lms_sign.Secret(bytes(24), bytes(16), 5, 4, 24)
    nodes = lms_sign.tree(secret, [lms_sign.leaf_node(secret, i) for i in range(32)])
    body = image.build(spec, compiler.compile_model(spec), None, 1)
    return bytearray(body), secret, nodes


@pytest.mark.parametrize(
    ("at", "value", "words"),
    [(0, 0, "not a model image"), (4, 9, "version 9"), (6, 88, "version 88"), (25, 65, "probe")],
)
def test_images_that_are_not_for_us_are_named(thesis, at, value, words):
    body, secret, nodes = signed_body(thesis)
    body[at] = value
    data = bytes(body) + lms_sign.sign(secret, nodes, 0, bytes(body), bytes(24))
    with pytest.raises(ImageError, match=words):
        image.inspect(data, lms_sign.public_key(secret, nodes))


def test_a_missing_feature_is_called_by_its_name(thesis):
    body, secret, nodes = signed_body(thesis)
    at = body.index(b"ln_stdev")
    body[at : at + 8] = b"wetness2"
    data = bytes(body) + lms_sign.sign(secret, nodes, 0, bytes(body), bytes(24))
    with pytest.raises(ImageError, match="wetness2"):
        image.inspect(data, lms_sign.public_key(secret, nodes))


@pytest.mark.parametrize("flip", [0, 500, -1])
def test_one_flipped_byte_gives_one_sentence(signed, public_key, flip):
    data = bytearray(signed[1])
    data[flip] ^= 16
    with pytest.raises(ImageError) as caught:
        image.inspect(bytes(data), public_key)
    assert "\n" not in str(caught.value)


def test_the_features_are_the_firmwares(field):
    assert set(field.features) <= set(firmware_features.NAMES)
