"""scikit-learn's transformers as polynomials: each takes columns and gives columns."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.refusals import fitted, is_a, refused
from palpate.fixedpoint.space import Array, Poly, Space, plus, times

_GRID = 2001


@dataclass(frozen=True)
class Raw:
    """A feature that nothing has been done to."""

    feature: int


Column = Raw | Poly


class Columns:
    """Columns on their way through a pipeline.

    Parameters
    ----------
    space : Space
    """

    def __init__(self, space: Space) -> None:
        self.space = space

    def poly(self, column: Column) -> Poly:
        """The column as a polynomial."""
        return self.space.linear(column.feature) if isinstance(column, Raw) else column

    def affine(self, column: Column, factor: float, offset: float) -> Poly:
        """factor * column + offset; a feature met for the first time is centred where this is zero."""
        if not math.isfinite(factor) or not math.isfinite(offset):
            raise CompileError("a scaler holds a number that is not finite, or a scale of 0; fit it again")
        if isinstance(column, Raw) and factor:
            return plus((factor, self.space.linear(column.feature, -offset / factor)), (offset, {(): 1.0}))
        return plus((factor, self.poly(column)), (offset, {(): 1.0}))

    def feature_of(self, column: Column) -> int | None:
        """The one feature that a column depends on; None if there are several or none."""
        if isinstance(column, Raw):
            return column.feature
        found = {self.space.atoms[k].feature for t in column for k in t}
        return found.pop() if len(found) == 1 else None

    def values(self, column: Column, x: Array) -> Array:
        """A column of one feature at that feature's values x."""
        if isinstance(column, Raw):
            return x
        total = np.zeros(len(x))
        for term, c in column.items():
            product = np.full(len(x), c)
            for k in term:
                atom = self.space.atoms[k]
                own = x if atom.function is None else atom.function(x)
                product = product * (own - atom.centre) / atom.radius
            total = total + product
        return total

    def function(
        self, column: Column, f: Callable[[Array], Array], name: str, kinks: Sequence[float] = ()
    ) -> Poly:
        """f of a column of one feature; kinks are values of the column."""
        i = self.feature_of(column)
        if i is None:
            raise CompileError(f"{name} is of several features at once; only functions of one are compiled")
        of = self.space.features[i]
        x = np.linspace(of.lo * of.step, of.hi * of.step, _GRID)
        v = self.values(column, x)
        places = []
        for kink in kinks:
            for k in np.nonzero((v[:-1] < kink) != (v[1:] < kink))[0]:
                lo, hi = x[k], x[k + 1]
                for _ in range(60):
                    middle = (lo + hi) / 2
                    same = (self.values(column, np.array([middle]))[0] < kink) == (v[k] < kink)
                    lo, hi = (middle, hi) if same else (lo, middle)
                places.append(hi)
        return self.space.function(i, lambda x: f(self.values(column, x)), f"{name} of {of.name}", places)

    # ---- transformers

    def through(self, step: Any, columns: list[Column], names: Sequence[str] | None = None) -> list[Column]:
        """What a transformer makes of columns; `names`: theirs, where they are still the data's."""
        if step is None or step == "passthrough":
            return columns
        n = getattr(step, "n_features_in_", len(columns))
        if n != len(columns):
            raise CompileError(f"{type(step).__name__} was fitted to {n} columns and is given {len(columns)}")
        if is_a(step, "Pipeline"):
            for _, inner in step.steps:
                columns = self.through(inner, columns, names)
                names = None
            return columns
        if is_a(step, "ColumnTransformer"):
            return self._by_column(step, columns, names)
        if is_a(step, "FeatureUnion"):
            return [c for _, inner in step.transformer_list for c in self.through(inner, columns, names)]
        if is_a(step, "StandardScaler"):
            fitted(step, "n_features_in_")
            mean = step.mean_ if step.with_mean else np.zeros(n)
            return self._scaled(columns, mean, step.scale_ if step.with_std else np.ones(n))
        if is_a(step, "RobustScaler"):
            fitted(step, "n_features_in_")
            centre = step.center_ if step.with_centering else np.zeros(n)
            return self._scaled(columns, centre, step.scale_ if step.with_scaling else np.ones(n))
        if is_a(step, "MaxAbsScaler"):
            return self._scaled(columns, np.zeros(n), fitted(step, "scale_").scale_)
        if is_a(step, "MinMaxScaler"):
            fitted(step, "scale_")
            made: list[Column] = [self.affine(c, a, b) for c, a, b in zip(columns, step.scale_, step.min_)]
            if step.clip:
                lo, hi = step.feature_range
                made = [
                    self.function(c, lambda v: np.clip(v, lo, hi), "MinMaxScaler", (lo, hi)) for c in made
                ]
            return made
        if is_a(step, "PolynomialFeatures"):
            return self._powers(fitted(step, "powers_").powers_, columns)
        if hasattr(step, "get_support"):
            fitted(step, "n_features_in_")
            return [columns[k] for k in step.get_support(indices=True)]
        if is_a(step, "PCA", "TruncatedSVD", "IncrementalPCA"):
            return self._components(step, columns)
        if is_a(step, "SimpleImputer"):
            if fitted(step, "statistics_").add_indicator:
                raise refused(step, "add_indicator=True asks for NaN", "add_indicator=False")
            return columns
        if is_a(step, "FunctionTransformer"):
            return self._functions(step, columns)
        if is_a(step, "SplineTransformer"):
            fitted(step, "bsplines_")
            return self._each(step, columns, [spline.t for spline in step.bsplines_])
        if is_a(step, "KBinsDiscretizer"):
            edges = list(fitted(step, "bin_edges_").bin_edges_)
            if step.encode == "ordinal":
                return self._each(step, columns, edges)
            raise refused(step, f"encode={step.encode!r}", "encode='ordinal', or trees")
        if is_a(step, "PowerTransformer"):
            return self._each(fitted(step, "lambdas_"), columns, [(0.0,)] * n)
        if is_a(step, "QuantileTransformer"):
            return self._each(fitted(step, "quantiles_"), columns, list(step.quantiles_.T))
        raise refused(step)

    def _scaled(self, columns: list[Column], centre: Any, scale: Any) -> list[Column]:
        with np.errstate(all="ignore"):
            factors = 1.0 / np.asarray(scale, float)
        return [self.affine(c, f, -m * f) for c, m, f in zip(columns, map(float, centre), factors.tolist())]

    def _powers(self, powers: Array, columns: list[Column]) -> list[Column]:
        polys = [self.poly(c) for c in columns]
        known: dict[tuple[int, ...], Poly] = {(): {(): 1.0}}
        out: list[Column] = []
        for row in powers:
            term = tuple(i for i, p in enumerate(row) for _ in range(int(p)))
            for n in range(1, len(term) + 1):
                if term[:n] not in known:
                    known[term[:n]] = times(known[term[: n - 1]], polys[term[n - 1]])
            out.append(known[term])
        return out

    def _components(self, step: Any, columns: list[Column]) -> list[Column]:
        rows = np.array(fitted(step, "components_").components_)
        mean = getattr(step, "mean_", np.zeros(rows.shape[1]))
        scale = np.sqrt(step.explained_variance_) if getattr(step, "whiten", False) else np.ones(len(rows))
        moved = [self.affine(c, 1.0, -float(m)) for c, m in zip(columns, mean)]
        return [plus(*zip((row / s).tolist(), moved)) for row, s in zip(rows, scale)]

    def _functions(self, step: Any, columns: list[Column]) -> list[Column]:
        if step.func is None:
            return columns
        n = len(columns)
        probes = np.stack([self._probe(c) for c in columns], axis=1)
        try:
            made = np.asarray(step.func(probes.copy(), **(step.kw_args or {})), float)
        except Exception as error:
            raise refused(step, f"its function failed on numpy columns ({error})") from None
        other = probes[::-1].copy()
        for i in range(n):
            mixed = other.copy()
            mixed[:, i] = probes[:, i]
            again = np.asarray(step.func(mixed, **(step.kw_args or {})), float)
            if made.shape != probes.shape or not np.array_equal(again[:, i], made[:, i], equal_nan=True):
                raise refused(
                    step,
                    "its function mixes columns, or changes their number",
                    "functions of one column each",
                )
        name = getattr(step.func, "__name__", "function")
        return [self.function(c, self._own(step, n, i, 1, 0, {}), name) for i, c in enumerate(columns)]

    def _probe(self, column: Column) -> Array:
        i = self.feature_of(column)
        if i is None:
            raise CompileError(
                "a FunctionTransformer is of several features at once; apply it to features first"
            )
        of = self.space.features[i]
        return self.values(column, np.linspace(of.lo * of.step, of.hi * of.step, 23))

    def _each(self, step: Any, columns: list[Column], kinks: Sequence[Any]) -> list[Column]:
        """A transformer that works on each column by itself."""
        n = len(columns)
        total = step.transform(np.stack([self._probe(c) for c in columns], axis=1)).shape[1]
        per = total // n
        name = type(step).__name__
        known: dict[tuple[int, bytes], Array] = {}
        return [
            self.function(c, self._own(step, n, i, per, k, known), name, np.asarray(kinks[i]).tolist())
            for i, c in enumerate(columns)
            for k in range(per)
        ]

    @staticmethod
    def _own(
        step: Any, n: int, i: int, per: int, k: int, known: dict[tuple[int, bytes], Array]
    ) -> Callable[[Array], Array]:
        """Column k of those that a transformer makes of column i; `known` are its latest answers."""

        def f(v: Array) -> Array:
            key = (i, np.asarray(v, float).tobytes())
            if key not in known:
                table = np.repeat(np.asarray(v, float)[:, None], n, axis=1)
                with np.errstate(all="ignore"):
                    made = np.asarray(_plain(step, table), float)[:, per * i : per * (i + 1)]
                if len(known) > 16:
                    known.clear()
                known[key] = made
            return known[key][:, k]

        return f

    def _by_column(self, step: Any, columns: list[Column], names: Sequence[str] | None) -> list[Column]:
        out: list[Column] = []
        fitted(step, "transformers_")
        for _, inner, chosen in step.transformers_:
            if isinstance(inner, str) and inner == "drop":
                continue
            places = _places(chosen, len(columns), names)
            own = [names[i] for i in places] if names else None
            out += self.through(inner, [columns[i] for i in places], own)
        return out


def _plain(step: Any, table: Array) -> Any:
    """transform without the warning that the table has no names."""
    import warnings

    if is_a(step, "FunctionTransformer"):
        return step.func(table, **(step.kw_args or {}))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = step.transform(table)
    return made.toarray() if hasattr(made, "toarray") else made


def _places(chosen: Any, n: int, names: Sequence[str] | None) -> list[int]:
    """Which columns a ColumnTransformer means."""
    if isinstance(chosen, slice):
        return list(range(n))[chosen]
    items = [chosen] if isinstance(chosen, str | int | np.integer) else list(chosen)
    if len(items) == n and all(isinstance(c, bool | np.bool_) for c in items):
        return [i for i, c in enumerate(items) if c]
    places = []
    for c in items:
        if isinstance(c, str):
            if names is None or c not in names:
                raise CompileError(
                    f"the ColumnTransformer wants the column {c!r}, which the data do not have"
                )
            places.append(list(names).index(c))
        else:
            places.append(int(c))
    return places
