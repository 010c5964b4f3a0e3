"""`export`: sizes, the report, and what it refuses before anything is signed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.model_export import image_builder as image
from palpate.model_export.errors import ExportError, ImageError, ModelError
from palpate.model_export.exporter import export
from palpate.model_export.signing import keys
from tests.model_export import small_key, synthetic
from tests.model_export.flashing import a_force_map, body_of

SIGNATURE = 7856


def test_a_field_model_with_force_map_and_intervals_has_2812_bytes_and_a_thesis_model_1128_and_a_signature(
    field, thesis, real_key_dir
):
    """Signed, they miss 8 kB and 3 kB: a signature without state is long (docs/model-image.md)."""
    data, report = export(dataclasses.replace(field, force_map=a_force_map()), real_key_dir)
    assert image.inspect(data).model.force_map is not None
    assert report.size == len(data) and report.signature_size == SIGNATURE
    assert len(data) <= 2812 + SIGNATURE
    assert len(body_of(thesis)) <= 1128


def test_the_report_measures_over_the_training_set_if_the_model_brings_it(thesis, key_dir):
    _, report = export(thesis, key_dir)
    assert report.over == "random vectors of the domain" and report.errors.n == 2000
    rows = np.random.default_rng(1).uniform(thesis.clip_lo, thesis.clip_hi, (29, 6)).tolist()
    trained = dataclasses.replace(thesis, training={**thesis.training, "features": rows})
    _, report = export(trained, key_dir)
    assert report.over == "the training set" and report.errors.n == 29
    assert max(report.errors.worst.values()) < 5e-5
    assert report.proof.largest < 2**30
    assert any("worst error" in line for line in report.lines())
    assert report.to_dict()["errors"]["n"] == 29


def test_the_counter_rises_with_every_export_and_a_rollback_says_how_far(thesis, key_dir):
    first = export(thesis, key_dir)[1]
    second = export(thesis, key_dir)[1]
    assert second.counter == first.counter + 1 and second.replaces == 0
    back = export(thesis, key_dir, counter=1, rollback=True)[1]
    assert back.counter == 1 and back.replaces >= second.counter


def test_an_image_says_what_it_is(field, key_dir):
    data, report = export(field, key_dir)
    info = image.inspect(data, (key_dir / "public.key").read_bytes())
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
def test_what_cannot_be_exported_is_named_and_gives_no_counter(thesis, key_dir, change, words):
    before = keys.load(key_dir).counter
    with pytest.raises(ExportError, match=words):
        export(dataclasses.replace(thesis, **change), key_dir)
    assert keys.load(key_dir).counter == before


def test_a_precision_that_is_no_metric_is_refused(thesis, key_dir):
    flat = dataclasses.replace(thesis.domain, precision=((0.0,) * 6,) * 6)
    with pytest.raises(ModelError, match="positive definite"):
        export(dataclasses.replace(thesis, domain=flat), key_dir)


def signed_body(spec):
    return bytearray(body_of(spec)), *small_key.signer()


@pytest.mark.parametrize(
    ("at", "value", "words"),
    [(0, 0, "not a model image"), (4, 9, "version 9"), (6, 88, "version 88"), (25, 65, "probe")],
)
def test_images_that_are_not_for_us_are_named(thesis, at, value, words):
    body, public, sign = signed_body(thesis)
    body[at] = value
    data = sign(bytes(body))
    with pytest.raises(ImageError, match=words):
        image.inspect(data, public)


def test_a_missing_feature_is_called_by_its_name(thesis):
    body, public, sign = signed_body(thesis)
    at = body.index(b"ln_stdev")
    body[at : at + 8] = b"wetness2"
    data = sign(bytes(body))
    with pytest.raises(ImageError, match="wetness2"):
        image.inspect(data, public)


@pytest.mark.parametrize("flip", [0, 500, -1])
def test_one_flipped_byte_gives_one_sentence(signed, public_key, flip):
    data = bytearray(signed[1])
    data[flip] ^= 16
    with pytest.raises(ImageError) as caught:
        image.inspect(bytes(data), public_key)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("number", [1e308, -1e308, 1e19, 1e17])
@pytest.mark.filterwarnings("error")
def test_a_coefficient_that_fixed_point_cannot_hold_is_one_sentence(thesis, key_dir, number):
    """1e308 was "unexpected", after warnings of numpy."""
    first, *others = thesis.outputs
    odd = dataclasses.replace(first, coefficients=(number, *first.coefficients[1:]))
    with pytest.raises(ExportError):
        export(dataclasses.replace(thesis, outputs=(odd, *others)).validate(), key_dir)
