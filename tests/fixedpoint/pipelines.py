"""Fitted models of scikit-learn, one of each kind that is compiled, by name: (model, X, y)."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from sklearn.compose import ColumnTransformer, TransformedTargetRegressor
from sklearn.cross_decomposition import PLSRegression
from sklearn.datasets import load_diabetes, make_friedman1, make_friedman2, make_friedman3
from sklearn.decomposition import PCA
from sklearn.ensemble import (
    ExtraTreesRegressor,
    GradientBoostingRegressor,
    HistGradientBoostingClassifier,
    HistGradientBoostingRegressor,
    RandomForestClassifier,
    RandomForestRegressor,
)
from sklearn.feature_selection import SelectKBest, VarianceThreshold, f_regression
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.kernel_ridge import KernelRidge
from sklearn.linear_model import (
    BayesianRidge,
    ElasticNet,
    HuberRegressor,
    Lasso,
    LinearRegression,
    LogisticRegression,
    PoissonRegressor,
    Ridge,
    RidgeClassifier,
)
from sklearn.model_selection import GridSearchCV
from sklearn.multioutput import MultiOutputRegressor
from sklearn.pipeline import FeatureUnion, make_pipeline
from sklearn.preprocessing import (
    FunctionTransformer,
    KBinsDiscretizer,
    MaxAbsScaler,
    MinMaxScaler,
    PolynomialFeatures,
    PowerTransformer,
    QuantileTransformer,
    RobustScaler,
    SplineTransformer,
    StandardScaler,
)
from sklearn.svm import SVR, LinearSVC

from palpate.fixedpoint import Program, from_sklearn

DIABETES = load_diabetes(return_X_y=True)
ONE = make_friedman1(300, n_features=6, random_state=0)
TWO = make_friedman2(300, random_state=0)
THREE = make_friedman3(300, random_state=0)
FEW = (ONE[0][:60], ONE[1][:60])
TWO_OUTPUTS = (DIABETES[0], np.c_[DIABETES[1], 100 * DIABETES[0][:, 0] - DIABETES[1]])
CLASSES = (DIABETES[0], np.digitize(DIABETES[1], [100, 200]))

COUNTS = (np.random.default_rng(3).integers(0, 4096, (300, 3)).astype(float), None)
"""Readings of a converter of 12 bits."""
COUNTS = (COUNTS[0], np.log1p(COUNTS[0][:, 0]) + 1e-3 * COUNTS[0][:, 1] - 1e-7 * COUNTS[0][:, 2] ** 2)

SCALED = StandardScaler
LINEAR: dict[str, tuple[Callable[[], Any], Any]] = {
    "least squares": (LinearRegression, DIABETES),
    "degree 2": (lambda: make_pipeline(SCALED(), PolynomialFeatures(2), Ridge()), DIABETES),
    "degree 3": (lambda: make_pipeline(SCALED(), PolynomialFeatures(3), Ridge()), ONE),
    "degree 3, not scaled": (lambda: make_pipeline(PolynomialFeatures(3), Ridge()), TWO),
    "degree 5": (lambda: make_pipeline(MinMaxScaler(), PolynomialFeatures(5), Ridge(1e-3)), TWO),
    "interactions": (
        lambda: make_pipeline(MaxAbsScaler(), PolynomialFeatures(2, interaction_only=True), Lasso(0.01)), TWO
    ),
    "splines": (lambda: make_pipeline(SplineTransformer(8), Ridge(0.1)), ONE),
    "splines times splines": (
        lambda: make_pipeline(
            SplineTransformer(3, degree=2, include_bias=False),
            PolynomialFeatures(2, interaction_only=True),
            Ridge(0.1),
        ),
        THREE,
    ),
    "logarithms": (
        lambda: make_pipeline(FunctionTransformer(np.log1p), SCALED(), PolynomialFeatures(2), Ridge(0.1)),
        THREE,
    ),
    "of counts": (lambda: make_pipeline(FunctionTransformer(np.log1p), SCALED(), Ridge(0.1)), COUNTS),
    "by columns": (
        lambda: make_pipeline(
            ColumnTransformer(
                [
                    ("roots", FunctionTransformer(np.sqrt), [0, 1]),
                    ("powers", make_pipeline(MinMaxScaler(), FunctionTransformer(np.exp)), [2, 3]),
                ]
            ),
            PolynomialFeatures(2),
            SCALED(),
            Lasso(0.1),
        ),
        TWO,
    ),
    "union": (lambda: make_pipeline(FeatureUnion([("a", SCALED()), ("b", PCA(2))]), Ridge()), ONE),
    "the best": (
        lambda: make_pipeline(SCALED(), PolynomialFeatures(2), SelectKBest(f_regression, k=9), Ridge()), ONE
    ),
    "robust": (lambda: make_pipeline(VarianceThreshold(), RobustScaler(), HuberRegressor()), DIABETES),
    "Bayes": (lambda: make_pipeline(SCALED(), BayesianRidge()), DIABETES),
    "searched": (
        lambda: GridSearchCV(make_pipeline(SCALED(), Ridge()), {"ridge__alpha": [1, 10]}), DIABETES
    ),
    "partial least squares": (lambda: PLSRegression(3), TWO_OUTPUTS),
    "principal components": (
        lambda: make_pipeline(SCALED(), PCA(4, whiten=True), PolynomialFeatures(2), LinearRegression()),
        DIABETES,
    ),
    "several outputs": (lambda: MultiOutputRegressor(ElasticNet(0.01)), TWO_OUTPUTS),
    "logarithm of the target": (
        lambda: TransformedTargetRegressor(
            make_pipeline(SCALED(), Ridge(10)), func=np.log, inverse_func=np.exp
        ),
        DIABETES,
    ),
    "scaled target": (lambda: TransformedTargetRegressor(Ridge(), transformer=SCALED()), DIABETES),
    "counts of events": (lambda: make_pipeline(SCALED(), PoissonRegressor()), DIABETES),
    "powers": (lambda: make_pipeline(PowerTransformer(), Ridge()), TWO),
    "quantiles": (lambda: make_pipeline(QuantileTransformer(n_quantiles=30), Ridge()), TWO),
    "bins": (lambda: make_pipeline(KBinsDiscretizer(6, encode="ordinal"), Ridge()), TWO),
}  # fmt: skip
TREES: dict[str, tuple[Callable[[], Any], Any]] = {
    "boosted histograms": (lambda: HistGradientBoostingRegressor(max_iter=20, max_leaf_nodes=15), ONE),
    "boosted counts": (lambda: HistGradientBoostingRegressor(loss="poisson", max_iter=20), TWO),
    "random forest": (lambda: make_pipeline(SCALED(), RandomForestRegressor(8, max_depth=6)), ONE),
    "forest of two outputs": (lambda: ExtraTreesRegressor(4, max_depth=5), (ONE[0], np.c_[ONE[1], -ONE[1]])),
    "boosted trees": (lambda: GradientBoostingRegressor(n_estimators=20), ONE),
}
KERNELS: dict[str, tuple[Callable[[], Any], Any]] = {
    "kernel ridge": (lambda: make_pipeline(SCALED(), KernelRidge(kernel="rbf", alpha=0.1, gamma=0.1)), FEW),
    "support vectors": (lambda: make_pipeline(SCALED(), SVR(C=10)), FEW),
    "Gaussian process": (
        lambda: make_pipeline(
            SCALED(),
            GaussianProcessRegressor(
                ConstantKernel() * RBF([2.0] * 6, (1, 10)) + WhiteKernel(0.3, (0.1, 1)), normalize_y=True
            ),
        ),
        FEW,
    ),
}
CLASSIFIERS: dict[str, tuple[Callable[[], Any], Any]] = {
    "logistic": (lambda: make_pipeline(SCALED(), LogisticRegression()), CLASSES),
    "support vectors, two classes": (
        lambda: make_pipeline(SCALED(), LinearSVC()),
        (DIABETES[0], CLASSES[1] > 1),
    ),
    "ridge": (RidgeClassifier, CLASSES),
    "boosted histograms, classes": (
        lambda: HistGradientBoostingClassifier(max_iter=5),
        (ONE[0], ONE[1] > 14),
    ),
    "random forest, classes": (
        lambda: RandomForestClassifier(8, max_depth=5),
        (ONE[0], np.digitize(ONE[1], [10, 15])),
    ),
}
ALL = LINEAR | TREES | KERNELS | CLASSIFIERS


@cache
def fitted(name: str) -> Any:
    """The model of this name, fitted, with its data."""
    make, (X, y) = ALL[name]
    model = make()
    for key in model.get_params():
        if key.endswith("random_state"):
            model.set_params(**{key: 0})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(X, y)
    return model, X, y


@cache
def program(name: str) -> Program:
    """Its program."""
    model, X, _ = fitted(name)
    return from_sklearn(model, X)
