"""What cannot be compiled is said in one sentence, with the nearest thing that can."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import statsmodels.api as sm
from sklearn.compose import TransformedTargetRegressor
from sklearn.ensemble import GradientBoostingRegressor, HistGradientBoostingRegressor, RandomForestRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import Matern
from sklearn.kernel_ridge import KernelRidge
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.neighbors import KNeighborsRegressor
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, Normalizer, PolynomialFeatures, StandardScaler

from palpate.fixedpoint import CompileError, compile, from_sklearn, from_statsmodels

RNG = np.random.default_rng(0)
X = RNG.uniform(1, 2, (80, 3))
Y = X @ [1.0, 2.0, 3.0] + X[:, 0] ** 2
LINE = LinearRegression().fit(X, Y)
MANY = RNG.uniform(1, 2, (50, 30))


def altered(**attributes):
    model = LinearRegression().fit(X, Y)
    for name, value in attributes.items():
        setattr(model, name, value)
    return model


def scaled(**attributes):
    model = make_pipeline(StandardScaler(), Ridge()).fit(X, Y)
    for name, value in attributes.items():
        setattr(model[0], name, value)
    return model


def without_leaves():
    model = RandomForestRegressor(2).fit(X, Y)
    model.estimators_[0].tree_.value[:] = np.nan
    return model


def without_weights():
    model = KernelRidge(kernel="rbf").fit(X[:30], Y[:30])
    model.dual_coef_[0] = np.nan
    return model


def swapped(rows):
    return rows[:, ::-1]


MODELS = {
    "a nan": (lambda: altered(coef_=np.array([1, np.nan, 2])), "coefficient that is not finite"),
    "an infinite intercept": (lambda: altered(intercept_=np.inf), "coefficient that is not finite"),
    "a scale of nan": (lambda: scaled(scale_=np.array([1, np.nan, 1])), "scaler holds a number that is not"),
    "a scale of 0": (lambda: scaled(scale_=np.array([1, 0, 1])), "or a scale of 0"),
    "an infinite mean": (lambda: scaled(mean_=np.array([1, np.inf, 1])), "scaler holds a number that is not"),
    "leaves of nan": (without_leaves, "y has a coefficient that is not finite"),
    "kernels of nan": (without_weights, "y has a coefficient that is not finite"),
    "1e300": (lambda: altered(coef_=np.array([1e300, 1, 1])), "reaches 2e\\+300 over its box"),
    "5,455 terms": (
        lambda: make_pipeline(PolynomialFeatures(3), Ridge()).fit(MANY, MANY.sum(1)), "has 5455 terms, 4096"
    ),
    "1e30 apart": (lambda: altered(coef_=np.array([1e30, 1.0, 0.0]), intercept_=0.0), None),
    "never fitted": (lambda: make_pipeline(StandardScaler(), Ridge()), "StandardScaler was never fitted"),
    "a line never fitted": (Ridge, "Ridge was never fitted"),
    "a forest never fitted": (RandomForestRegressor, "RandomForestRegressor was never fitted"),
    "histograms never fitted": (HistGradientBoostingRegressor, "was never fitted"),
    "a network": (lambda: MLPRegressor(max_iter=1).fit(X, Y), "MLPRegressor .* take HistGrad"),
    "neighbours": (lambda: KNeighborsRegressor().fit(X, Y), "KNeighborsRegressor .* take RandomForest"),
    "a normalizer": (lambda: make_pipeline(Normalizer(), Ridge()).fit(X, Y), "Normalizer .* StandardScaler"),
    "another kernel": (lambda: KernelRidge(kernel="laplacian").fit(X, Y), "laplacian.*kernel='rbf'"),
    "Matern": (lambda: GaussianProcessRegressor(Matern()).fit(X, Y), r"Matern.*RBF\(\)"),
    "mixed columns": (
        lambda: make_pipeline(FunctionTransformer(swapped), Ridge()).fit(X, Y), "mixes columns"
    ),
    "another target": (
        lambda: TransformedTargetRegressor(Ridge(), func=np.sqrt, inverse_func=np.square).fit(X, Y),
        "inverse function is not exp",
    ),
    "an init of its own": (lambda: GradientBoostingRegressor(init=Ridge()).fit(X, Y), "init=None"),
    "another library": (lambda: object(), "object cannot be compiled"),
}  # fmt: skip


def one_sentence(caught):
    text = str(caught.value)
    assert "\n" not in text and 20 < len(text) < 300 and not text.endswith(".")


@pytest.mark.parametrize("name", [n for n, (_, match) in MODELS.items() if match])
def test_a_model_that_cannot_be_compiled(name):
    make, match = MODELS[name]
    with pytest.raises(CompileError, match=match) as caught:
        from_sklearn(make(), MANY if "terms" in name else X)
    one_sentence(caught)


def test_what_is_1e30_times_smaller_is_left_out():
    """Float64 itself gives the same with and without it."""
    model = MODELS["1e30 apart"][0]()
    program = from_sklearn(model, X)
    assert program.values(X)[:, 0] == pytest.approx(model.predict(X), rel=1e-5)


BAD = {
    "nan": (([(0,)], [np.nan], [(0, 1)]), "nan, not finite"),
    "infinite": (([(0,)], [np.inf], [(0, 1)]), "inf, not finite"),
    "no width": (([(0,)], [1.0], [(1, 1)]), "no width"),
    "turned round": (([(0,)], [1.0], [(2, 1)]), "no width"),
    "endless": (([(0,)], [1.0], [(0, np.inf)]), "finite ends"),
    "1e30 apart": (([(0,), (1,)], [1.0, 1e30], [(0, 1)] * 2), "1e\\+30 times that of x0"),
    "10,000 terms": (
        ([(i, j) for i in range(100) for j in range(100)], np.ones(10_000), [(0, 1)] * 100), "terms"
    ),
    "an index": (([(3,)], [1.0], [(0, 1)]), "no tuple of indices of the 1 features"),
    "no tuple": (([0], [1.0], [(0, 1)]), "the term 0 is no tuple"),
    "no terms": (([], [], [(0, 1)]), "a term and a feature at least"),
    "text": (([(0,)], ["a"], [(0, 1)]), "coefficients must be numbers"),
    "too narrow": (([(0,)], [1.0], [(1, 1 + 1e-15)]), "1.1e-15 wide, too little beside 1"),
    "one end": (([(0,)], [1.0], [1.0]), "must be two numbers, not 1.0"),
    "e^1000": (([(0,)], [1000.0], [(0, 1)], 1, {"links": ["exp"]}), "beyond 1e\\+100"),
    "a centre of nan": (([(0,)], [1.0], [(0, 1)], 1, {"centre": [np.nan]}), "1 finite numbers"),
    "shapes": (([(0,)], [1.0, 2.0], [(0, 1)]), "shape"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_terms_that_make_no_sense(name):
    (*arguments, last), match = BAD[name]
    more = last if isinstance(last, dict) else {}
    with pytest.raises(CompileError, match=match) as caught:
        compile(*arguments, *([] if more else [last]), **more)
    one_sentence(caught)


DATA = {
    "a nan": (np.where(X[5, 1] == X, np.nan, X), {}, "column 1 in row 5"),
    "too few columns": (X[:, :2], {}, "fitted to 3 features, X has 2"),
    "text": ([["a", "b", "c"]], {}, "X's entries must be numbers"),
    "a box of text": (X, {"box": [("a", 1), (1, 2), (1, 2)]}, "must be two numbers"),
    "one name twice": (X, {"names": ["a", "a", "b"]}, "two features have one name"),
    "a box of width 0": (X, {"box": [(1, 1), (1, 2), (1, 2)]}, "no width"),
    "a box of another feature": (X, {"box": {"x7": (0, 1)}}, "names 'x7', which is none of"),
    "names": (X, {"names": ["a"]}, "3 of x"),
    "units": (X, {"units": ["mm", "kPa"]}, "units has 2 entries for 1 outputs"),
    "steps": (X, {"steps": [1e-12, None, None]}, "take steps of"),
    "too few to calibrate": (X, {"calibrate": (X[:5], Y[:5])}, "too few"),
    "calibrated on text": (X, {"calibrate": (X, ["a"] * 80)}, "calibrate's y must be numbers"),
    "calibrated on constants": (X, {"calibrate": (X * 0 + 1.5, Y)}, "constant features"),
    "calibrated on fewer": (X, {"calibrate": (X, Y[:50])}, "80 rows of X and y of shape"),
    "calibrated on nothing": (X, {"calibrate": X}, "must be a pair"),
    "within two": (X, {"within": [1.0, 2.0]}, "within must be 1 positive numbers"),
    "within nothing": (X, {"within": [0.0]}, "within must be 1 positive numbers"),
    "precise nowhere": (X, {"precise": "corners"}, "precise is .box. or .data., not 'corners'"),
    "a level": (X, {"calibrate": (X, Y), "level": 1.5}, "between 0 and 1"),
}


@pytest.mark.parametrize("name", DATA)
def test_data_that_do_not_fit(name):
    data, more, match = DATA[name]
    with pytest.raises(CompileError, match=match) as caught:
        from_sklearn(LINE, data, **more)
    one_sentence(caught)


def test_columns_of_another_name_are_named():
    frame = pd.DataFrame(X, columns=["a", "b", "c"])
    model = Ridge().fit(frame, Y)
    with pytest.raises(CompileError, match="a column 'b', which X does not have"):
        from_sklearn(model, frame.rename(columns={"b": "q"}))
    with pytest.raises(CompileError, match="'a' where it has 'b'"):
        from_sklearn(model, frame[["b", "a", "c"]])
    with pytest.raises(CompileError, match="no column 'b'"):
        from_sklearn(model, frame).predict(frame[["a", "c"]])


def test_a_constant_column_does_no_harm():
    constant = np.c_[X, np.full(len(X), 7.0)]
    program = from_sklearn(make_pipeline(StandardScaler(), Ridge()).fit(constant, Y), constant)
    assert program.errors[-1].worst < 1e-5 * np.std(Y)


def test_links_that_have_no_integers():
    results = sm.GLM(Y.mean() < Y, sm.add_constant(X), family=sm.families.Binomial()).fit()
    with pytest.raises(CompileError, match=r"Logit.*take the link Log or Identity"):
        from_statsmodels(results, X)
    with pytest.raises(CompileError, match="never fitted"):
        from_statsmodels(sm.OLS(Y, X), X)
