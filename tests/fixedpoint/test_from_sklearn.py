"""A fitted pipeline of scikit-learn becomes integers that say what it says, with their proof."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import statsmodels.api as sm
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from palpate.fixedpoint import CompileError, from_sklearn, from_statsmodels
from tests.fixedpoint import pipelines, running

REGRESSORS = {**pipelines.LINEAR, **pipelines.TREES, **pipelines.KERNELS}
WORST = dict.fromkeys(REGRESSORS, 1e-5) | {"Gaussian process": 1e-4}
"""Of the target's standard deviation; a Gaussian process adds up large weights of both signs."""


@pytest.mark.parametrize("name", REGRESSORS)
def test_the_integers_add_next_to_nothing(name):
    model, X, _ = pipelines.fitted(name)
    program = pipelines.program(name)
    assert program.values(X) == pytest.approx(
        np.asarray(model.predict(X)).reshape(len(X), -1), abs=WORST[name] * program.errors[-1].spread * 2
    )
    assert running.worst(program) < WORST[name]


@pytest.mark.parametrize("name", pipelines.ALL)
def test_the_proof_holds_on_random_vectors_and_corners(name):
    _, X, _ = pipelines.fitted(name)
    program = pipelines.program(name)
    x = running.vectors(program, X, 2000)
    assert running.largest(program, x) <= program.proof.largest < 2**30
    out = program.code.run(x, len(program.outputs))
    for k, o in enumerate(program.outputs):
        assert o.lo <= out[:, k].min() and out[:, k].max() <= o.hi


@pytest.mark.long
@pytest.mark.parametrize("name", pipelines.ALL)
def test_the_proof_holds_on_a_million_vectors(name):
    program = pipelines.program(name)
    rng = np.random.default_rng(7)
    lo, hi = ([getattr(f, end) for f in program.features] for end in ("lo", "hi"))
    for _ in range(20):
        x = rng.integers(lo, hi, (50_000, len(lo)), endpoint=True)
        assert running.largest(program, x) <= program.proof.largest
    assert running.largest(program, program.quantised(program.box(4096))) <= program.proof.largest


@pytest.mark.parametrize("name", pipelines.CLASSIFIERS)
def test_a_classifier_s_verdict_is_its_own(name):
    model, X, _ = pipelines.fitted(name)
    program = pipelines.program(name)
    said = [program.classes[k] for k in program.predict(X)[:, -1]]
    assert np.mean(np.array(said) == model.predict(X)) > 0.995  # but where two decisions are equal
    assert program.outputs[-1].name == "verdict"


def test_intervals_hold_what_they_promise():
    X, y = pipelines.ONE
    rng = np.random.default_rng(0)
    more = rng.uniform(size=(900, 6))
    truth = 10 * np.sin(np.pi * more[:, 0] * more[:, 1]) + 20 * (more[:, 2] - 0.5) ** 2 + 10 * more[:, 3]
    truth += 5 * more[:, 4] + rng.normal(size=900)
    model = make_pipeline(StandardScaler(), PolynomialFeatures(2), Ridge()).fit(X, y)
    program = from_sklearn(model, X, calibrate=(more[:300], truth[:300]), level=0.8)
    assert [o.name for o in program.outputs] == ["y", "y_low", "y_high", "inside"]
    _, low, high, inside = program.values(more[300:]).T
    covered = (low <= truth[300:]) & (truth[300:] <= high)
    assert 0.75 < covered.mean() < 0.85
    assert inside.mean() > 0.95
    far = more[300:].copy()
    far[:, 0] += 1.0
    assert program.predict(far)[:, -1].max() == 0
    assert program.predict([[0.5] * 6])[0, -1] == 1


def test_calibration_takes_nothing_of_the_proof_s_margin():
    """The domain compares features, which may be anything at all; what is compared is not computed with."""
    model, X, y = pipelines.fitted("least squares")
    program = from_sklearn(model, X, calibrate=(X, y))
    assert program.proof.headroom_bits > 0.3 and program.proof.where != "f"
    assert running.largest(program, running.vectors(program, X, 2000)) <= program.proof.largest


def test_a_constant_column_is_calibrated_too():
    X, y = pipelines.ONE
    constant = np.c_[X, np.full(len(X), 7.0)]
    model = make_pipeline(StandardScaler(), PolynomialFeatures(2), Ridge()).fit(constant, y)
    program = from_sklearn(model, constant, calibrate=(constant, y))
    assert program.predict(constant)[:, -1].mean() > 0.95


def test_intervals_wider_than_the_predictions_can_be_are_proved_too():
    """Within a row they could overflow: residuals of a poor model are larger than all that it says."""
    X, y = pipelines.ONE
    noise = np.random.default_rng(0).normal(size=len(y))
    model = make_pipeline(StandardScaler(), Ridge()).fit(X, 3e-3 * y)
    program = from_sklearn(model, X, calibrate=(X, noise))
    _, low, high, _ = program.values(X).T
    assert np.mean((low <= noise) & (noise <= high)) >= 0.9
    assert running.largest(program, running.vectors(program, X)) <= program.proof.largest < 2**30
    with pytest.raises(CompileError, match="is it the model's target"):
        from_sklearn(model, X, calibrate=(X, 1e9 * noise))


def test_whoever_wants_less_precision_gets_a_shorter_program():
    model, X, y = pipelines.fitted("degree 3")
    usual = pipelines.program("degree 3")
    coarse = from_sklearn(model, X, within=[1e-3 * np.std(y)], precise="data")
    assert len(coarse.python()) < len(usual.python())
    assert running.worst(usual) < 1e-5 < running.worst(coarse) < 1e-3


def test_a_data_frame_s_columns_are_found_by_name():
    X = pd.DataFrame(pipelines.TWO[0], columns=["a", "b", "c", "d"])
    model = make_pipeline(StandardScaler(), Ridge()).fit(X, pipelines.TWO[1])
    program = from_sklearn(model, X, units=("mm",), output_names=("reach",))
    assert [f.name for f in program.features] == ["a", "b", "c", "d"]
    assert np.array_equal(program.predict(X[["d", "c", "b", "a"]]), program.predict(X))
    assert program.outputs[0].unit == "mm" and program.outputs[0].name == "reach"


def test_readings_of_a_converter_go_in_as_they_are():
    _, X, _ = pipelines.fitted("of counts")
    program = pipelines.program("of counts")
    assert [f.step for f in program.features] == [1.0, 1.0, 1.0]
    assert np.array_equal(program.quantised(X), X)


@pytest.mark.parametrize("kind", ["OLS", "RLM", "GLM", "Poisson"])
def test_results_of_statsmodels(kind):
    X = pd.DataFrame(pipelines.DIABETES[0], columns=[f"f{i}" for i in range(10)])
    exogenous, y = sm.add_constant(X), pipelines.DIABETES[1]
    results = {
        "OLS": lambda: sm.OLS(y, exogenous),
        "RLM": lambda: sm.RLM(y, exogenous),
        "GLM": lambda: sm.GLM(y, exogenous),
        "Poisson": lambda: sm.GLM(y, exogenous, family=sm.families.Poisson()),
    }[kind]().fit()
    program = from_statsmodels(results, X)
    want = np.asarray(results.predict(exogenous))
    assert np.abs(program.values(X)[:, 0] - want).max() < 1e-5 * want.std()
    same = from_statsmodels(results, X.to_numpy())
    assert np.array_equal(same.predict(X.to_numpy()), program.predict(X))


def test_a_value_on_a_tree_s_threshold_goes_its_way_behind_a_scaler_too():
    """Of more than 255 values some are thresholds; a scaler's zero was half a step off: they went wrong."""
    rng = np.random.default_rng(0)
    X = rng.uniform(0.5, 3, (300, 4))
    y = X[:, 0] * X[:, 1] + np.sqrt(X[:, 2])
    model = make_pipeline(StandardScaler(), HistGradientBoostingRegressor(max_iter=20)).fit(X, y)
    assert np.abs(from_sklearn(model, X).values(X)[:, 0] - model.predict(X)).max() < 1e-5


def test_a_process_whose_weights_cancel_is_held_where_none_of_its_values_gets():
    """Weights of 90,000 for values of 1.5: the sum could reach what 31 bits do not hold, and was refused."""
    rng = np.random.default_rng(0)
    X = rng.uniform(0.5, 3, (80, 4))
    y = X[:, 0] * X[:, 1] + 0.1 * rng.normal(size=80)
    model = GaussianProcessRegressor(ConstantKernel(150) * RBF(9) + WhiteKernel(0.01), optimizer=None)
    program = from_sklearn(make_pipeline(StandardScaler(), model).fit(X, y), X)
    assert program.proof.largest < 2**30
    assert program.errors[-1].rms < 1e-3 * program.errors[-1].spread
