"""What is refused, by its name, with the nearest thing that is taken."""

from __future__ import annotations

from typing import Any

from palpate.fixedpoint.errors import CompileError

_NEAREST = {
    "MLPRegressor": "HistGradientBoostingRegressor, or KernelRidge with kernel='rbf'",
    "MLPClassifier": "HistGradientBoostingClassifier",
    "KNeighborsRegressor": "RandomForestRegressor, or KernelRidge with kernel='rbf'",
    "KNeighborsClassifier": "RandomForestClassifier",
    "NuSVR": "KernelRidge with kernel='rbf'",
    "SVC": "LinearSVC after PolynomialFeatures",
    "NuSVC": "LinearSVC after PolynomialFeatures",
    "GaussianNB": "LogisticRegression after PolynomialFeatures(2)",
    "GaussianProcessClassifier": "LogisticRegression after PolynomialFeatures",
    "AdaBoostRegressor": "GradientBoostingRegressor",
    "AdaBoostClassifier": "HistGradientBoostingClassifier",
    "BaggingRegressor": "RandomForestRegressor",
    "VotingRegressor": "one of its regressors",
    "StackingRegressor": "one of its regressors",
    "RegressorChain": "MultiOutputRegressor",
    "IsotonicRegression": "SplineTransformer and Ridge",
    "Normalizer": "StandardScaler",
    "OneHotEncoder": "a feature of 0 and 1 for each category, made before",
    "OrdinalEncoder": "numbers for the categories, made before",
    "KNNImputer": "data without NaN: a device's sensors give none",
    "IterativeImputer": "data without NaN: a device's sensors give none",
    "MissingIndicator": "data without NaN: a device's sensors give none",
    "KernelPCA": "PCA, or Nystroem's kernel in KernelRidge",
    "Nystroem": "KernelRidge with kernel='rbf'",
    "RBFSampler": "KernelRidge with kernel='rbf'",
    "TfidfVectorizer": "features that are numbers",
}
_REGRESSORS = "a linear regression after PolynomialFeatures or SplineTransformer, trees, or KernelRidge"
_TRANSFORMERS = "StandardScaler, PolynomialFeatures, SplineTransformer or a FunctionTransformer"


def refused(thing: Any, why: str = "", instead: str = "") -> CompileError:
    """The error: what it is, why if there is more to say, and what to take instead."""
    name = type(thing).__name__
    default = _TRANSFORMERS if hasattr(thing, "transform") else _REGRESSORS
    nearest = instead or _NEAREST.get(name, default)
    return CompileError(f"{name} cannot be compiled{f': {why}' if why else ''}; take {nearest}")


def fitted(thing: Any, *attributes: str) -> Any:
    """The thing itself; CompileError if it was never fitted."""
    for attribute in attributes:
        if not hasattr(thing, attribute):
            raise CompileError(f"the {type(thing).__name__} was never fitted; call fit on the pipeline first")
    return thing


def is_a(thing: Any, *names: str) -> bool:
    """Whether it is of a class of scikit-learn's (or one derived from it) of one of these names."""
    return any(c.__name__ in names and c.__module__.startswith("sklearn.") for c in type(thing).__mro__)
