"""model.json: what is written is read, and what is wrong is named in one sentence."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import json
import math

import pytest

from palpate import models
from palpate.model_export.errors import ExportError, ModelError
from palpate.model_export.schema import ModelSpec


@pytest.fixture(scope="module")
def data(thesis):
    return json.loads(json.dumps(thesis.to_dict()))


def test_a_model_comes_back_as_it_was_written(field, tmp_path):
    field.save(tmp_path / "model.json")
    assert ModelSpec.load(tmp_path / "model.json") == field
    assert list(tmp_path.iterdir()) == [tmp_path / "model.json"]


def broken(data, change):
    other = copy.deepcopy(data)
    change(other)
    return other


def set_(*path, value):
    def change(d):
        for key in path[:-1]:
            d = d[key]
        d[path[-1]] = value

    return change


WRONG = [
    (set_("format", value="other"), "not a Palpate model"),
    (set_("version", value=1), "version 1"),
    (set_("kind", value="guess"), "kind"),
    (set_("probe", value="a name that is much too long"), "probe"),
    (set_("features_version", value=0), "features_version"),
    (set_("surprise", value=1), "surprise"),
    (lambda d: d.pop("terms"), "terms"),
    (lambda d: d["outputs"].pop(), "outputs must be"),
    (lambda d: d["outputs"][0].pop("link"), "lacks 'link'"),
    (set_("outputs", 1, "link", value="log10"), "link of t_mm"),
    (set_("outputs", 1, "lo", value=0.0), "t_mm"),
    (lambda d: d["outputs"][2]["coefficients"].pop(), "coefficients of d_mm"),
    (set_("scale", 0, value=0.0), "scale of ln_base"),
    (set_("clip_lo", 0, value=99.0), "clip_lo of ln_base"),
    (set_("clip_hi", 0, value=40.0), "ln_base"),
    (set_("terms", 1, value=[9]), "terms[1]"),
    (set_("terms", 1, value=[0, 0, 0, 0]), "degree 4"),
    (set_("terms", 1, value=[1, 0]), "sorted"),
    (set_("terms", 1, value=[1]), "twice"),
    (set_("interval", "level", value=1.5), "interval.level"),
    (set_("interval", "quantiles", 0, value=[-1.0, 1.0]), "negative"),
    (set_("interval", "coefficients", 0, value=[0.0]), "interval.coefficients[0]"),
    (set_("domain", "threshold", value=0.0), "threshold"),
    (set_("domain", "precision", 0, 1, value=1e9), "symmetric"),
    (set_("domain", "lo", 0, value=-31.0), "domain of ln_base"),
    (lambda d: d["domain"]["ranges"].pop(), "domain.ranges must have a pair"),
    (set_("domain", "ranges", 0, value=[1.0]), "domain.ranges of F_N_per_m"),
    (set_("domain", "ranges", 2, value=[30.0, 3.0]), "domain.ranges of d_mm"),
    (set_("domain", "ranges", 2, value=[3.0, 4000.0]), "domain.ranges of d_mm"),
    (set_("domain", "ranges", 3, value=["0.3", None]), "domain.ranges of h"),
    (set_("domain", "margin", value=-0.1), "domain.margin"),
    (set_("domain", "margin", value=4.0), "domain.margin"),
    (set_("interval", "terms", 1, value=[0, 1]), "interval.terms"),
    (lambda d: d["domain"].pop("ranges"), "lacks 'ranges'"),
    (set_("hard_below", value=0), "hard_below"),
    (set_("force_range", value=[3, 2]), "force_range"),
    (set_("training", "hash", value="abc"), "hash"),
    (set_("training", "n", value=0), "training"),
    (set_("force_map", value=3), "force_map"),
    (set_("centre", 0, value=True), "centre[0]"),
    (set_("centre", 0, value="1"), "centre[0]"),
    (set_("lump", 0, "hi", value=99.0), "lump[0].hi"),
]


@pytest.mark.parametrize(("change", "words"), WRONG, ids=[w for _, w in WRONG])
def test_what_is_wrong_is_named(data, change, words):
    with pytest.raises(ModelError) as caught:
        ModelSpec.from_dict(broken(data, change))
    assert words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("word", ["NaN", "Infinity", "-Infinity"])
def test_numbers_that_are_none_are_refused_reading_and_writing(thesis, tmp_path, word):
    path = tmp_path / "model.json"
    thesis.save(path)
    text = path.read_text()
    path.write_text(text.replace('"hard_below": 0.3', f'"hard_below": {word}'))
    with pytest.raises(ModelError, match=word):
        ModelSpec.load(path)
    bad = dataclasses.replace(thesis, hard_below=float(word.replace("Infinity", "inf")))
    with pytest.raises(ModelError):
        bad.save(path)
    for part in ("training", "notes", "force_map"):
        nested = {"hash": "0" * 64, "n": 1, "deep": [{"x": float(word.replace("Infinity", "inf"))}]}
        with pytest.raises(ModelError, match=part):
            dataclasses.replace(thesis, **{part: nested}).validate()


def test_a_failed_save_leaves_the_old_file(thesis, tmp_path):
    path = tmp_path / "model.json"
    thesis.save(path)
    before = path.read_bytes()
    with pytest.raises(ModelError):
        dataclasses.replace(thesis, hard_below=math.nan).save(path)
    assert path.read_bytes() == before


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff\xfe", b"3"])
def test_a_file_that_is_no_model_is_refused(tmp_path, content):
    (tmp_path / "model.json").write_bytes(content)
    with pytest.raises(ExportError):
        ModelSpec.load(tmp_path / "model.json")
    with pytest.raises(ExportError, match="cannot read"):
        ModelSpec.load(tmp_path / "missing.json")


def places(value, path=()):
    """The path of every value in a model, one of each list."""
    yield path
    parts = (
        value.items() if isinstance(value, dict) else enumerate(value[:1]) if isinstance(value, list) else ()
    )
    for key, part in parts:
        yield from places(part, (*path, key))


def test_a_value_of_the_wrong_shape_anywhere_is_a_sentence(data):
    junk = (None, True, -1, 10**19, 1e308, "x", [], {}, [[]], [{}], {"a": [None]}, [["x"]])
    for path in [p for p in places(data) if p]:
        for value in junk:
            with contextlib.suppress(ModelError):  # a few are sound, as a note that is empty
                ModelSpec.from_dict(broken(data, set_(*path, value=value)))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[" * 200_000 + "]" * 200_000, "nested too deep"),
        ('{"format": ' + '{"a":' * 90_000 + "1" + "}" * 90_001, "nested too deep"),
        (
            '{"format": "palpate-model", "version": 2, "kind": ' + "[" * 500 + "]" * 500 + "}",
            "nested too deep",
        ),
        ('{"format": "palpate-model", "version": ' + "9" * 400 + "}", "an integer of 400 digits"),
        ('{"format": "palpate-model", "version": ' + "9" * 9000 + "}", "an integer of 9000 digits"),
    ],
)
def test_hostile_json_is_a_sentence(tmp_path, text, says):
    """Deep nesting was a RecursionError, an integer of 400 digits an OverflowError."""
    path = tmp_path / "model.json"
    path.write_text(text)
    with pytest.raises(ModelError, match=says) as told:
        ModelSpec.load(path)
    assert len(str(told.value)) < 300


def test_an_integer_beyond_any_float_is_no_number(data):
    with pytest.raises(ModelError, match="an integer of 1329 bits"):
        ModelSpec.from_dict(broken(data, set_("centre", 0, value=10**400)))


# ---- what the host adds: width and place across the stroke, and the layer in which a lump lies


def document(name):
    """The bundled model of this name, as it is in its file."""
    return json.loads(json.dumps(models.load(name).to_dict()))


@pytest.fixture(scope="module")
def solid():
    return document(models.BALLS)


@pytest.fixture(scope="module")
def anywhere():
    return document(models.ANYWHERE)


@pytest.mark.parametrize(("name", "part"), [(models.BALLS, "across"), (models.ANYWHERE, "layers")])
def test_a_model_may_tell_what_the_host_adds_or_not(name, part):
    told = document(name)
    whole = ModelSpec.from_dict(told)
    assert getattr(whole, part) is not None and whole.to_dict() == models.load(name).to_dict()
    older = ModelSpec.from_dict({key: value for key, value in told.items() if key != part})
    assert older == dataclasses.replace(whole, **{part: None})
    assert part not in older.to_dict()


@pytest.mark.parametrize(
    ("model", "change", "words"),
    [
        ("solid", set_("across", value=3), "across must be an object"),
        ("solid", lambda d: d["across"].pop("width"), "across lacks 'width'"),
        ("solid", set_("across", "width", value=None), "across.width must be an object"),
        ("solid", set_("across", "surprise", value=1), "surprise"),
        ("solid", set_("across", "level", value=0), "across.level"),
        ("solid", set_("across", "width", "features", 0, value="ln_base"), "none of the model's features"),
        ("solid", set_("across", "width", "terms", 1, value=[99]), "across.width.terms[1]"),
        ("solid", set_("across", "width", "estimates", value=[]), "across.width.estimates"),
        ("solid", lambda d: d["across"]["width"]["estimates"].append(
            {**d["across"]["width"]["estimates"][0], "name": "other"}), "one estimate"),
        ("solid", lambda d: d["across"]["width_spread"].pop(), "across.width_spread"),
        ("solid", set_("across", "width_spread", 0, value=1e9), "spread must lie within"),
        ("solid", set_("across", "place_stretch", value=-1.0), "across.place_stretch"),
        ("solid", set_("across", "place_spread", value=[1.0]), "across.place_spread"),
        ("solid", set_("across", "place_spread", 1, value="wide"), "across.place_spread[1]"),
        ("anywhere", set_("layers", value=3), "layers must be an object"),
        ("anywhere", lambda d: d["layers"].pop("slope"), "layers lacks 'slope'"),
        ("anywhere", set_("layers", "surprise", value=1), "surprise"),
        ("anywhere", set_("layers", "level", value=1), "layers.level"),
        ("anywhere", set_("layers", "sure", value=0.5), "layers.sure"),
        ("anywhere", set_("layers", "slope", value=-11.0), "layers.slope"),
        ("anywhere", lambda d: d["layers"]["spread"].pop(), "layers.spread must have a row"),
        ("anywhere", lambda d: d["layers"]["spread"][1].pop(), "layers.spread[1]"),
        ("anywhere", set_("layers", "spread", 2, 0, value=1e9), "spread must lie within"),
        ("anywhere", set_("layers", "quantiles", 0, value=[1.0]), "layers.quantiles[0]"),
        ("anywhere", set_("layers", "quantiles", 2, 1, value=0.0), "must be positive"),
        ("anywhere", set_("layers", "quantiles", 1, value="wide"), "layers.quantiles[1]"),
    ],
)  # fmt: skip
def test_a_damaged_part_that_the_host_adds_is_named(request, model, change, words):
    test_what_is_wrong_is_named(request.getfixturevalue(model), change, words)
