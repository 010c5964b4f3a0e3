"""A regression of scikit-learn over the probe's features becomes an image that a probe takes and runs."""

from __future__ import annotations

import json
from array import array

import numpy as np
import pandas as pd
import pytest
import skops.io
from sklearn.compose import TransformedTargetRegressor
from sklearn.ensemble import RandomForestRegressor
from sklearn.kernel_ridge import KernelRidge
from sklearn.linear_model import LinearRegression, Ridge, RidgeClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, PolynomialFeatures, StandardScaler

from firmware_py import evaluator, feature_names, outputs, slots, status
from firmware_py import features as firmware_features
from palpate import models
from palpate.cli import main
from palpate.errors import PalpateError
from palpate.firmware_twin.replay_core import Replay
from palpate.fixedpoint import from_sklearn
from palpate.link.flash import flash as probe_flash
from palpate.model_export import image_builder, program_image
from palpate.model_export.errors import ModelError
from palpate.model_export.integers import reference, sampling
from palpate.model_export.signing import keys
from palpate.sim.probe.flash_sim import FlashSim
from palpate.stroke.replay import replay
from tests.host.conftest import bench, emulated, palpate, strokes
from tests.host.probes import connect
from tests.model_export.flashing import flash, probe_of

__all__ = ["bench", "emulated", "palpate", "strokes"]

ROWS = 600
NAMES = ("d_mm", "E_inv23")


@pytest.fixture(scope="module")
def felt():
    """Features like those of strokes, by name, and what `field` says of each."""
    spec = models.load("field")
    own = [i for i, name in enumerate(spec.features) if name in feature_names.NAMES]
    X = sampling.in_domain(spec, ROWS)
    said = reference.evaluate(spec, X)["value"]
    return pd.DataFrame(X[:, own], columns=[spec.features[i] for i in own]), pd.DataFrame(
        said, columns=outputs.NAMES
    )


def cubic():
    return make_pipeline(StandardScaler(), PolynomialFeatures(2), Ridge(0.1))


def compiled(model, X, Y, **options):
    """Fitted to the first half, calibrated by the second."""
    half = len(X) // 2
    model.fit(X[:half], Y[:half])
    given = {"output_names": list(Y.columns), "calibrate": (X[half:], Y[half:]), "level": 0.8} | options
    return from_sklearn(model, X, **given)


@pytest.fixture(scope="module")
def program(felt):
    X, Y = felt
    return compiled(cubic(), X, Y[list(NAMES)])


@pytest.fixture(scope="session")
def key(real_key_dir):
    return real_key_dir


@pytest.fixture(scope="module")
def image(program, key):
    return program.image(key, models.load("field"))


def answers(model, names, X):
    """The evaluator's integers for features X."""
    x = array("i", [0] * firmware_features.COUNT)
    found = []
    for row in np.round(X.to_numpy() * 2**24).astype(int).tolist():
        for name, value in zip(names, row):
            x[feature_names.NAMES.index(name)] = value
        out = array("i", [0] * evaluator.OUT_SIZE)
        model.evaluate(x, out)
        found.append(out.tolist())
    return np.array(found)


def test_the_evaluator_says_what_the_pipeline_says(program, key, felt):
    """Of a diameter in millimetres without a logarithm, which no image could hold before."""
    X, _ = felt
    plain, report = program_image.image(program, key)
    got = answers(image_builder.inspect(plain).model, X.columns, X)
    want = program.model.reference(X.to_numpy())
    for k, name in enumerate(NAMES):
        value, low, high = (got[:, 3 * outputs.NAMES.index(name) + part] / 1e6 for part in range(3))
        assert np.abs(value - want[:, k]).max() < 5e-5 * np.abs(want[:, k]).max()
        half = program.calibration.half_widths[k]
        assert np.abs(high - low - 2 * half).max() < 1e-3 * half or (high - low <= 2.001 * half).all()
    assert report.errors.worst["d_mm"] < 5e-5 and report.proof.largest < 2**30
    inside = got[:, evaluator.FLAGS] & evaluator.IN_DOMAIN > 0
    assert 0.8 < inside.mean() <= 1


def test_outputs_that_it_does_not_tell_are_nothing(program, key, felt):
    X, _ = felt
    got = answers(image_builder.inspect(program.image(key)).model, X.columns, X[:20])
    for j, name in enumerate(outputs.NAMES):
        if name not in NAMES:
            assert np.abs(got[:, 3 * j : 3 * j + 3]).max() <= 1


def test_a_diameter_alone_is_neither_hard_nor_soft(felt, key):
    X, Y = felt
    found = compiled(cubic(), X, Y[["d_mm"]]).image(key)
    got = answers(image_builder.inspect(found).model, X.columns, X[:20])
    assert not (got[:, evaluator.FLAGS] & (evaluator.HARD | evaluator.SOFT | evaluator.FORCE_OUT)).any()


def test_logarithms_of_the_target_are_links(felt, key):
    X, Y = felt
    model = TransformedTargetRegressor(cubic(), func=np.log, inverse_func=np.exp)
    found = compiled(model, X, Y["t_mm"].to_frame())
    _, report = program_image.image(found, key)
    assert report.errors.worst["t_mm"] < 5e-5


def test_slots_take_it_verify_it_and_keep_it_when_the_power_goes(image, key):
    public = keys.load(key).public
    store = FlashSim()
    probe = probe_of(store, public)
    assert flash(probe, image) == status.OK
    again = probe_of(store, public)
    assert again.model.model_id == image[40:48] == probe.model.model_id
    damaged = image[:500] + bytes([image[500] ^ 1]) + image[501:]
    assert flash(again, damaged) == status.BAD_SIGNATURE
    assert probe_of(store, public).model.model_id == image[40:48]


def test_two_programs_are_two_stages(felt, key):
    X, Y = felt
    first = compiled(
        LinearRegression(), X, np.log(Y[["E_fat_kPa"]]).rename(columns={"E_fat_kPa": "ln_tissue"})
    )
    more = X.assign(ln_tissue=first.model.reference(X.to_numpy())[:, 0])
    second = compiled(cubic(), more, Y[["d_mm"]])
    data, _ = program_image.image(second, key, first=first)
    got = answers(image_builder.inspect(data).model, X.columns, X)
    want = second.model.reference(more.to_numpy())[:, 0]
    at = 3 * outputs.NAMES.index("d_mm")
    assert np.abs(got[:, at] / 1e6 - want).max() < 2e-4 * np.abs(want).max()


def of_a_stroke(bench):
    """A made-up law of features about those that a stroke has: what a stranger could have measured."""
    pipeline = Replay(plain=True)
    pipeline.stream(bench[0][0], bench[1])
    spec = models.load("field")
    own = [i for i in range(len(spec.features)) if spec.features[i] in feature_names.NAMES[:30]]
    names = [spec.features[i] for i in own]
    here = [pipeline.features()[feature_names.NAMES.index(name)] for name in names]
    rng = np.random.default_rng(3)
    X = pd.DataFrame(here + 0.05 * rng.normal(size=(400, len(names))), columns=names)
    z = (X - here).to_numpy() @ rng.normal(size=(len(names), 2))
    Y = pd.DataFrame({"d_mm": 12 + 3 * z[:, 0] + z[:, 1] ** 2, "t_mm": 20 + 5 * z[:, 1]})
    return compiled(cubic(), X, Y + 0.01 * rng.normal(size=Y.shape))


def test_a_probe_takes_it_answers_a_stroke_and_replays_it_bit_for_bit(
    bench, emulated, key, palpate, tmp_path
):
    program = of_a_stroke(bench)
    image = program.image(key)
    device = emulated("micropython")
    with connect(device) as probe:
        assert probe_flash(probe, image).model_id == image[40:48].hex()
    visit = tmp_path / "visit.mcap"
    code, said, wrong = palpate("stream", "--port", device.port, "--strokes", 1, "--record", visit, "--json")
    assert code == 0, wrong
    (again,) = replay(visit)
    assert again.identical and again.features_equal
    told = again.probe.outputs
    assert told.keys() == {"d_mm", "t_mm"} and json.dumps(told["d_mm"]["value"]) in said
    assert told["d_mm"]["low"] < told["d_mm"]["value"] < told["d_mm"]["high"]
    assert again.probe.in_domain and again.probe.hardness == "unsure"
    code, lines, wrong = palpate("replay", visit)
    assert code == 0 and "lump diameter d" in lines and "stiffness" not in lines, wrong


FOREST = RandomForestRegressor(3, max_depth=3, random_state=0)
REFUSED = {
    "trees": (lambda X, Y: compiled(FOREST, X, Y["d_mm"].to_frame()), "runs no trees; take a linear"),
    "kernels": (
        lambda X, Y: compiled(KernelRidge(kernel="rbf"), X[:80], Y[["d_mm"]][:80]),
        "runs no kernels; take Ridge",
    ),
    "functions": (
        lambda X, Y: compiled(
            make_pipeline(FunctionTransformer(np.exp), Ridge()), X[["ln_force"]], Y[["d_mm"]]
        ),
        "is a function of one",
    ),
    "other features": (
        lambda X, Y: compiled(Ridge(), X.iloc[:, :1].set_axis(["hall"], axis=1), Y[["d_mm"]]),
        "computes no feature called 'hall'",
    ),
    "other outputs": (
        lambda X, Y: compiled(Ridge(), X, Y[["d_mm"]].set_axis(["gap_mm"], axis=1)),
        "not gap_mm; name the outputs so",
    ),
    "degree 4": (
        lambda X, Y: compiled(
            make_pipeline(StandardScaler(), PolynomialFeatures(4), Ridge()), X.iloc[:, :2], Y[["d_mm"]]
        ),
        "up to degree 3",
    ),
    "no interval": (
        lambda X, Y: compiled(Ridge(), X, Y[["d_mm"]], calibrate=None),
        "gives no answer without an interval",
    ),
    "a classifier": (
        lambda X, Y: from_sklearn(RidgeClassifier().fit(X, Y["d_mm"] > 12), X),
        "holds no classifier",
    ),
    "too large": (
        lambda X, Y: compiled(Ridge(), X, 100 * Y[["d_mm"]]),
        "the evaluator tells what lies between -500 and 500",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_the_probe_cannot_run_is_refused_by_name(name, felt, key):
    make, words = REFUSED[name]
    made = make(*felt)
    with pytest.raises(PalpateError, match=words) as found:
        made.image(key)
    assert isinstance(found.value, ModelError) and "\n" not in str(found.value)


def test_the_command_writes_one(felt, key, tmp_path, capsys):
    X, Y = felt
    table = X.assign(d_mm=Y["d_mm"])
    table[:300].to_csv(tmp_path / "strokes.csv", index=False)
    table[300:].to_csv(tmp_path / "more.csv", index=False)
    skops.io.dump(cubic().fit(X[:300], Y["d_mm"][:300]), tmp_path / "model.skops")
    words = ["compile", tmp_path / "model.skops", "--data", tmp_path / "strokes.csv", "--target", "d_mm"]
    words += ["--out", tmp_path / "model.palp"]
    assert main([*map(str, words)]) == 2
    assert "not signed; give --key" in capsys.readouterr().err
    assert main([*map(str, [*words, "--key", key])]) != 0
    assert "without an interval" in capsys.readouterr().err
    words += ["--calibrate", tmp_path / "more.csv", "--key", key, "--like", "field"]
    assert main([*map(str, words)]) == 0
    found = image_builder.inspect((tmp_path / "model.palp").read_bytes(), keys.load(key).public)
    assert found.signature == "good" and found.features == tuple(X.columns)


def of_a_board(y, links=None):
    """A program of two readings of a converter, whose target is y of them."""
    rng = np.random.default_rng(5)
    X = pd.DataFrame(rng.integers(200, 3900, (400, 2)), columns=["hall", "thermistor"])
    model = cubic()
    if links is not None:
        model = TransformedTargetRegressor(model, func=np.log, inverse_func=np.exp)
    target = np.asarray(y(X["hall"] / 4000, X["thermistor"] / 4000))
    model.fit(X[:200], target[:200])
    calibrate = (X[200:], target[200:])
    return from_sklearn(model, X, output_names=["gap"], calibrate=calibrate), X


@pytest.mark.parametrize("scale", [3e-7, 1.0, 2e5])
@pytest.mark.parametrize("links", [None, "log"])
def test_a_board_of_one_s_own_is_told_outputs_of_any_size(scale, links, key):
    """The probe tells millionths of up to 500; a board's outputs have a power of ten each."""
    program, X = of_a_board(lambda a, b: scale * (1 + a + a * b), links)
    image = program.image(key, device="gap meter")
    slots_ = slots.Slots(FlashSim(), keys.load(key).public, 1, 2, b"gap meter")
    slots_.boot()
    assert flash(slots_, image) == status.OK
    (told,) = program_image.device_outputs(program)
    x, out = array("i", [0, 0]), array("i", [0] * evaluator.OUT_SIZE)
    want = program.model.reference(X.to_numpy().astype(float))[:, 0]
    for row, true in zip(X[:50].to_numpy().tolist(), want):
        x[0], x[1] = row
        assert slots_.model.evaluate(x, out) == status.OK
        assert out[0] * told.step == pytest.approx(true, rel=5e-5)
        assert out[1] < out[0] < out[2]


def test_an_image_for_another_board_is_refused(key):
    program, _ = of_a_board(lambda a, b: 1 + a + b)
    image = program.image(key, device="gap meter")
    for name in (b"other meter", b"16x26 at 1500 um"):
        other = slots.Slots(FlashSim(), keys.load(key).public, 1, 2, name)
        other.boot()
        assert flash(other, image) == status.BAD_PROBE
    with pytest.raises(PalpateError, match="made for the probe 'gap meter'"):
        image_builder.inspect(image)


BOARDS = {
    "like": ({"like": True}, "a board of one's own has neither"),
    "a long name": ({"device": "a meter of the gap between"}, "1 to 16 ASCII characters"),
}


@pytest.mark.parametrize("name", BOARDS)
def test_what_a_board_s_image_cannot_have(name, key):
    given, words = BOARDS[name]
    program, _ = of_a_board(lambda a, b: 1 + a + b)
    with pytest.raises(ModelError, match=words):
        program.image(key, **{"device": "gap meter"} | given)


def test_seven_outputs_and_twenty_five_features_are_too_many(key):
    rng = np.random.default_rng(2)
    X = rng.normal(size=(200, 25))
    for Y, words in ((X[:, :7], "tells 6 outputs, not 7"), (X.sum(axis=1), "takes 24 features, not 25")):
        program = from_sklearn(LinearRegression().fit(X, Y), X, calibrate=(X, Y))
        with pytest.raises(ModelError, match=words):
            program.image(key, device="a board")
