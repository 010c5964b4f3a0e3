"""`from_sklearn`: fitted pipelines of scikit-learn, read without importing it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from palpate.fixedpoint import data, trees
from palpate.fixedpoint.assembly import Model
from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.kernels import Kernels
from palpate.fixedpoint.options import Options
from palpate.fixedpoint.program import Program
from palpate.fixedpoint.refusals import fitted, is_a, refused
from palpate.fixedpoint.space import Array, Poly, Space, plus
from palpate.fixedpoint.transformers import Column, Columns, Raw

LINEAR = (
    "LinearRegression", "Ridge", "RidgeCV", "Lasso", "LassoCV", "ElasticNet", "ElasticNetCV", "Lars",
    "LassoLars", "LassoLarsCV", "LassoLarsIC", "OrthogonalMatchingPursuit", "BayesianRidge", "ARDRegression",
    "HuberRegressor", "TheilSenRegressor", "QuantileRegressor", "SGDRegressor", "LinearSVR",
    "PassiveAggressiveRegressor", "MultiTaskLasso", "MultiTaskElasticNet",
)  # fmt: skip
LOGARITHMIC = ("PoissonRegressor", "GammaRegressor", "TweedieRegressor")
CLASSIFIERS = (
    "LogisticRegression", "LogisticRegressionCV", "LinearSVC", "RidgeClassifier", "RidgeClassifierCV",
    "SGDClassifier", "Perceptron", "LinearDiscriminantAnalysis",
)  # fmt: skip
_WRAPPERS = {"GridSearchCV": "best_estimator_", "RandomizedSearchCV": "best_estimator_",
             "HalvingGridSearchCV": "best_estimator_", "RANSACRegressor": "estimator_"}  # fmt: skip


def from_sklearn(model: Any, X: Any, **options: Any) -> Program:
    """A fitted pipeline, or regressor or classifier, as integers.

    Parameters
    ----------
    X : array or DataFrame (n, features)
        What the model takes: features' ranges are taken from it, precision is chosen and errors told over it.
    options
        Of `Options`.

    Raises
    ------
    CompileError, ProofError
        In one sentence: what cannot be compiled by its name, with the nearest thing that can.
    """
    wanted = Options(**options)
    table, columns = data.table(X)
    _fits(model, table, columns)
    space = wanted.space(table, columns)
    found = _Reader(space).read(model, [Raw(i) for i in range(len(space.features))], columns)
    found.reference = _reference(model, found, columns)
    return wanted.program(found, table, columns)


def _fits(model: Any, table: Array, columns: list[str] | None) -> None:
    """CompileError where the model was fitted to other columns."""
    known = getattr(model, "feature_names_in_", None)
    lacking = [] if known is None or columns is None else [n for n in known if n not in columns]
    if lacking:
        raise CompileError(f"the model was fitted to a column {lacking[0]!r}, which X does not have")
    if known is not None and columns is not None and list(known) != columns:
        wrong = next(f"{a!r} where it has {b!r}" for a, b in _pairs(known, columns) if a != b)
        raise CompileError(f"the model was fitted to other columns than X has: {wrong}")
    n = getattr(model, "n_features_in_", table.shape[1])
    if n != table.shape[1]:
        raise CompileError(f"the model was fitted to {n} features, X has {table.shape[1]}")


def _pairs(a: Sequence[str], b: Sequence[str]) -> list[tuple[Any, Any]]:
    n = max(len(a), len(b))
    return list(zip([*a, *[None] * (n - len(a))], [*b, *[None] * (n - len(b))]))


def _reference(model: Any, found: Model, columns: list[str] | None) -> Callable[[Array], Array]:
    """What the model itself gives for features, n x outputs."""

    def reference(X: Array) -> Array:
        import warnings

        table: Any = X
        if columns is not None:
            import pandas

            table = pandas.DataFrame(X, columns=columns)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if not found.classes:
                y = model.predict(table)
            elif hasattr(model, "decision_function"):
                y = model.decision_function(table)
            else:
                y = model.predict_proba(table)
        return np.asarray(y, float).reshape(len(X), -1)

    return reference


class _Reader:
    """Reads estimators into a Model."""

    def __init__(self, space: Space) -> None:
        self.space, self.columns = space, Columns(space)

    def read(self, model: Any, columns: list[Column], names: Sequence[str] | None) -> Model:
        """The model of an estimator over these columns."""
        for name, attribute in _WRAPPERS.items():
            if is_a(model, name):
                return self.read(getattr(fitted(model, attribute), attribute), columns, names)
        if is_a(model, "Pipeline"):
            for _, step in model.steps[:-1]:
                columns = self.columns.through(step, columns, names)
                names = None
            return self.read(model.steps[-1][1], columns, names)
        if is_a(model, "TransformedTargetRegressor"):
            return self._of_target(model, columns, names)
        if is_a(model, "MultiOutputRegressor"):
            parts = [self.read(m, columns, names) for m in fitted(model, "estimators_").estimators_]
            return self._joined(model, parts)
        if is_a(model, *LINEAR):
            return self._linear(fitted(model, "coef_"), columns)
        if is_a(model, *LOGARITHMIC):
            fitted(model, "coef_")
            power = getattr(model, "power", 1)
            if is_a(model, "TweedieRegressor") and (
                model.link == "identity" or (model.link == "auto" and power <= 0)
            ):
                return self._linear(model, columns)
            return self._linear(model, columns, "exp")
        if is_a(model, "PLSRegression", "PLSCanonical"):
            mean = fitted(model, "coef_", "_x_mean")._x_mean
            moved: list[Column] = [self.columns.affine(c, 1.0, -float(m)) for c, m in zip(columns, mean)]
            return self._linear(model, moved)
        if is_a(model, *CLASSIFIERS):
            found = self._linear(fitted(model, "coef_", "classes_"), columns)
            return self._classes(found, model.classes_)
        if is_a(model, "KernelRidge", "GaussianProcessRegressor", "SVR"):
            return self._kernels(model, columns)
        if is_a(model, "DummyRegressor"):
            constants = np.ravel(fitted(model, "constant_").constant_)
            return self._model([{(): float(c)} for c in constants])
        if hasattr(model, "estimators_") or hasattr(model, "tree_") or hasattr(model, "_predictors"):
            return self._trees(model, columns)
        if is_a(model, "BaseEnsemble", "BaseHistGradientBoosting", "BaseDecisionTree"):
            fitted(model, "estimators_" if is_a(model, "BaseEnsemble") else "tree_")
        raise refused(model)

    def _model(self, polys: list[Poly], link: str = "identity") -> Model:
        names = data.named(None, len(polys), "y")
        return Model(self.space, polys, names, [""] * len(polys), [link] * len(polys), lambda X: X)

    def _linear(self, model: Any, columns: list[Column], link: str = "identity") -> Model:
        rows = np.atleast_2d(np.asarray(model.coef_, float))
        if rows.shape[1] != len(columns):
            raise CompileError(
                f"{type(model).__name__} was fitted to {rows.shape[1]} columns and is given {len(columns)}"
            )
        constants = np.broadcast_to(np.ravel(np.asarray(model.intercept_, float)), len(rows))
        if not (np.isfinite(rows).all() and np.isfinite(constants).all()):
            raise CompileError(f"{type(model).__name__} has a coefficient that is not finite; fit it again")
        used = np.nonzero(rows.any(axis=0))[0]
        polys = [self.columns.poly(columns[i]) for i in used]
        return self._model(
            [plus(*zip(row[used].tolist(), polys), (float(c), {(): 1.0})) for row, c in zip(rows, constants)],
            link,
        )

    def _classes(self, found: Model, classes: Any) -> Model:
        found.classes = list(classes)
        n = len(found.polys)
        found.names = ["decision"] if n == 1 else [f"decision_{c}" for c in classes]
        return found

    def _of_target(self, model: Any, columns: list[Column], names: Sequence[str] | None) -> Model:
        found = self.read(fitted(model, "regressor_").regressor_, columns, names)
        target = model.transformer_
        if is_a(target, "FunctionTransformer"):
            pair = (target.func, target.inverse_func)
            if pair == (None, None):
                return found
            at = np.array([[0.5], [1.0], [2.5]])
            if found.links == ["identity"] * len(found.links) and np.allclose(pair[1](at), np.exp(at)):
                found.links = ["exp"] * len(found.links)
                return found
            raise refused(
                model,
                "its inverse function is not exp",
                "func=np.log and inverse_func=np.exp, or a StandardScaler",
            )
        if is_a(target, "StandardScaler", "MinMaxScaler", "RobustScaler", "MaxAbsScaler"):
            ends = np.asarray(target.inverse_transform(np.repeat([[0.0], [1.0]], len(found.polys), axis=1)))
            found.polys = [
                plus((float(b - a), p), (float(a), {(): 1.0})) for p, a, b in zip(found.polys, *ends)
            ]
            if found.forests is not None:
                raise refused(model, "a scaled target adds nothing to trees", "the trees alone")
            return found
        raise refused(
            model, f"its target goes through {type(target).__name__}", "func=np.log and inverse_func=np.exp"
        )

    def _joined(self, model: Any, parts: list[Model]) -> Model:
        kinds = {p.forests is None for p in parts}
        if len(kinds) > 1 or any(p.kernels for p in parts) or any(p.classes for p in parts):
            raise refused(model, "its estimators are of several kinds", "one kind, linear or of trees")
        out = self._model([q for p in parts for q in p.polys])
        out.links = [link for p in parts for link in p.links]
        if parts[0].forests is not None:
            out.forests = [t for p in parts for t in p.forests or []]
        return out

    # ---- trees

    def _trees(self, model: Any, columns: list[Column]) -> Model:
        splits = trees.Splits(self.space, columns, model)
        classes = list(getattr(model, "classes_", [])) if is_a(model, "ClassifierMixin") else []
        if is_a(model, "BaseHistGradientBoosting"):
            forests = [
                [trees.of_histograms(stage[k].nodes, splits, model) for stage in model._predictors]
                for k in range(len(model._predictors[0]))
            ]
            constants = np.ravel(np.asarray(model._baseline_prediction, float))
            link = "exp" if getattr(model, "loss", "") in ("poisson", "gamma") else "identity"
            found = self._model([{(): float(c)} for c in constants], link)
        elif is_a(model, "BaseGradientBoosting"):
            if not is_a(model.init_, "DummyRegressor", "DummyClassifier"):
                raise refused(model, "its init is an estimator of its own", "init=None")
            forests = [
                [
                    trees.of_arrays(e.tree_, model.learning_rate * e.tree_.value[:, 0, 0], splits)
                    for e in model.estimators_[:, k]
                ]
                for k in range(model.estimators_.shape[1])
            ]
            zero = np.zeros((1, model.n_features_in_))
            constants = np.ravel(model._raw_predict_init(zero))
            found = self._model([{(): float(c)} for c in constants])
        elif is_a(model, "BaseForest", "BaseDecisionTree"):
            parts = [model] if hasattr(model, "tree_") else model.estimators_
            outputs = len(classes) if classes else model.n_outputs_
            if classes and model.n_outputs_ > 1:
                raise refused(model, "it has several outputs of classes", "one classifier an output")
            forests = []
            for k in range(outputs):
                values = [p.tree_.value[:, 0, k] if classes else p.tree_.value[:, k, 0] for p in parts]
                if classes:
                    values = [v / p.tree_.value[:, 0].sum(axis=1) for v, p in zip(values, parts)]
                forests.append(
                    [trees.of_arrays(p.tree_, v / len(parts), splits) for p, v in zip(parts, values)]
                )
            found = self._model([{(): 0.0} for _ in forests])
        else:
            raise refused(model)
        found.forests = forests
        return self._classes(found, classes) if classes else found

    # ---- kernels

    def _kernels(self, model: Any, columns: list[Column]) -> Model:
        scale, offset, amplitude = np.ones(1), np.zeros(1), 1.0
        if is_a(model, "KernelRidge"):
            fitted(model, "dual_coef_")
            if model.kernel != "rbf":
                raise refused(
                    model, f"kernel={model.kernel!r}", "kernel='rbf', or Ridge after PolynomialFeatures"
                )
            gamma = 1.0 / model.X_fit_.shape[1] if model.gamma is None else model.gamma
            supports, weights = model.X_fit_, model.dual_coef_
            lengths: Any = math.sqrt(1 / (2 * gamma))
        elif is_a(model, "SVR"):
            fitted(model, "dual_coef_")
            if model.kernel != "rbf":
                raise refused(model, f"kernel={model.kernel!r}", "kernel='rbf', or LinearSVR")
            supports, weights = model.support_vectors_, model.dual_coef_.T
            lengths, offset = math.sqrt(1 / (2 * model._gamma)), np.ravel(model.intercept_)
        else:
            amplitude, lengths = _radial(fitted(model, "kernel_").kernel_, model)
            supports, weights = model.X_train_, model.alpha_
            scale, offset = np.ravel(model._y_train_std), np.ravel(model._y_train_mean)
        weights = np.asarray(weights, float).reshape(len(supports), -1)
        roots = np.broadcast_to(np.sqrt(0.5) / np.asarray(lengths, float), supports.shape[1])
        z = [plus((float(r), self.columns.poly(c))) for r, c in zip(roots, columns)]
        found = self._model([{(): float(o)} for o in np.broadcast_to(offset, weights.shape[1])])
        found.kernels = Kernels(z, np.asarray(supports, float) * roots, (amplitude * weights * scale).T)
        return found


def _radial(kernel: Any, model: Any) -> tuple[float, Any]:
    """(amplitude, lengths) of constant * RBF (+ noise)."""
    name = type(kernel).__name__
    if name == "Sum" and type(kernel.k2).__name__ == "WhiteKernel":
        return _radial(kernel.k1, model)
    if name == "Product":
        parts = [kernel.k1, kernel.k2]
        constants = [p.constant_value for p in parts if type(p).__name__ == "ConstantKernel"]
        rest = [p for p in parts if type(p).__name__ != "ConstantKernel"]
        if len(constants) == 1 and len(rest) == 1:
            amplitude, lengths = _radial(rest[0], model)
            return amplitude * constants[0], lengths
    if name == "RBF":
        return 1.0, kernel.length_scale
    raise refused(model, f"its kernel is {kernel}", "ConstantKernel() * RBF() + WhiteKernel()")
