"""A fitted pipeline as other tools, and people, bring it onto a microcontroller: C, and Python of floats.

What these tools do not take, scaling and products of features, is written here as one would by hand,
straight on. All begin with the features' values as floats; ours begins with integers.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.fixedpoint import Program


@dataclass(frozen=True)
class Contender:
    """C with `in`, `out` and `once`, which works out one prediction.

    Attributes
    ----------
    given, gives : str
        numpy's types of `in` and `out`.
    step : float
        What 1 of `out[0]` stands for.
    """

    name: str
    source: str
    given: str = "<f4"
    gives: str = "<f4"
    step: float = 1.0
    suffix: str = "c"
    include: str = ""


@dataclass(frozen=True)
class Linear:
    """StandardScaler, PolynomialFeatures and a linear regression, as numbers."""

    mean: np.ndarray
    scale: np.ndarray
    terms: list[tuple[int, ...]]
    coefficients: np.ndarray
    intercept: float

    @staticmethod
    def of(pipeline: Any) -> Linear:
        """Of a fitted pipeline; the constant term is left out: its coefficient is 0."""
        scaler, powers, model = (step for _, step in pipeline.steps)
        terms = [tuple(i for i, p in enumerate(row) for _ in range(int(p))) for row in powers.powers_]
        kept = [k for k, t in enumerate(terms) if t]
        return Linear(
            scaler.mean_, scaler.scale_, [terms[k] for k in kept], model.coef_[kept], float(model.intercept_)
        )

    def model(self) -> Any:
        """The linear part alone, for generators."""
        from sklearn.linear_model import LinearRegression

        model = LinearRegression()
        model.coef_, model.intercept_, model.n_features_in_ = (
            self.coefficients,
            self.intercept,
            len(self.terms),
        )
        return model

    def c(self, real: str, suffix: str) -> str:
        """Scaling and products: `static void glue(void)` makes `m` of `in`."""
        lines = [f"static {real} m[{len(self.terms)}];", "static void glue(void)", "{"]
        for i, (mean, scale) in enumerate(zip(self.mean, self.scale)):
            lines.append(f"    {real} z{i} = (in[{i}] - {mean:.17g}{suffix}) * {1 / scale:.17g}{suffix};")
        for k, term in enumerate(self.terms):
            lines.append(f"    m[{k}] = {' * '.join(f'z{i}' for i in term)};")
        return "\n".join([*lines, "}"]) + "\n"

    def python(self) -> str:
        """The same in Python: `def glue(x)` gives m."""
        lines = ["def glue(x):"]
        for i, (mean, scale) in enumerate(zip(self.mean, self.scale)):
            lines.append(f"    z{i} = (x[{i}] - {float(mean)!r}) * {float(1 / scale)!r}")
        products = (" * ".join(f"z{i}" for i in term) for term in self.terms)
        return "\n".join([*lines, f"    return [{', '.join(products)}]"]) + "\n"


def _arrays(features: int, given: str, gives: str, outputs: int = 1) -> str:
    return f"#include <stdint.h>\n{given} in[{features}];\n{gives} out[{outputs}];\n"


def ours(program: Program) -> Contender:
    """What `program.c()` writes."""
    text = program.c() + _arrays(len(program.features), "int32_t", "int32_t", len(program.outputs))
    return Contender(
        "palpate, int32",
        text + "void once(void) { predict(in, out); }\n",
        "<i4",
        "<i4",
        program.outputs[0].step,
    )


def _m2cgen(model: Any, features: int, glue: str, source: str) -> Contender:
    import m2cgen

    text = _arrays(features, "double", "double") + m2cgen.export_to_c(model) + glue
    return Contender("m2cgen, double", text + f"void once(void) {{ {source} }}\n", "<f8", "<f8")


def _micromlgen(model: Any, features: int, name: str, glue: str, source: str) -> Contender:
    import micromlgen

    text = (
        micromlgen.port(model)
        .replace("#pragma once", "")
        .replace("#include <cstdarg>", "#include <stdarg.h>")
    )
    call = f'static Eloquent::ML::Port::{name} model;\nextern "C" void once(void) {{ {source} }}\n'
    return Contender(
        "micromlgen, float32", _arrays(features, "float", "float") + text + glue + call, suffix="cpp"
    )


def _emlearn(model: Any, features: int, glue: str, source: str, **how: Any) -> Contender:
    import contextlib
    import tempfile
    from pathlib import Path

    import emlearn

    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):  # it builds a wrapper in ./tmp
        emlearn.convert(model, return_type="regressor", **how).save(name="model", file="model.h")
        text = Path("model.h").read_text()
    text = _arrays(features, "float", "float") + text + glue + f"void once(void) {{ {source} }}\n"
    return Contender("emlearn, float32", text, include=str(emlearn.includedir))


def linear_in_c(pipeline: Any) -> list[Callable[[], Contender]]:
    """Makers of the contenders of a linear pipeline, but for ours."""
    parts = Linear.of(pipeline)
    n, k = len(parts.mean), len(parts.terms)
    single = parts.c("float", "f")

    def plain() -> Contender:
        values = ", ".join(f"{c:.9g}f" if "e" in f"{c:.9g}" or "." in f"{c:.9g}" else f"{c:.9g}.0f"
                           for c in parts.coefficients)  # fmt: skip
        text = (
            f"static const float c[{k}] = {{{values}}};\n"
            f"void once(void) {{ glue(); float y = {parts.intercept:.9e}f; "
            f"for (int i = 0; i < {k}; i++) y += c[i] * m[i]; out[0] = y; }}\n"
        )
        return Contender("by hand, float32", _arrays(n, "float", "float") + single + text)

    def network() -> Contender:
        from sklearn.neural_network import MLPRegressor

        model = MLPRegressor(hidden_layer_sizes=(1,), activation="identity", max_iter=1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model.fit(np.random.default_rng(1).normal(size=(50, k)), np.arange(50.0))
        model.coefs_ = [parts.coefficients[:, None], np.eye(1)]
        model.intercepts_ = [np.array([parts.intercept]), np.zeros(1)]
        return _emlearn(model, n, single, f"glue(); out[0] = model_regress1(m, {k});", method="loadable")

    return [
        lambda: _m2cgen(parts.model(), n, parts.c("double", ""), "glue(); out[0] = score(m);"),
        plain,
        network,
        lambda: _micromlgen(
            parts.model(), n, "LinearRegression", single, "glue(); out[0] = model.predict(m);"
        ),
    ]


def trees_in_c(forest: Any) -> list[Callable[[], Contender]]:
    """Likewise of a RandomForestRegressor."""
    n = forest.n_features_in_
    return [
        lambda: _m2cgen(forest, n, "", "out[0] = score(in);"),
        lambda: _emlearn(forest, n, "", f"out[0] = model_predict(in, {n});", method="inline", dtype="float"),
        lambda: _micromlgen(forest, n, "RandomForestRegressor", "", "out[0] = model.predict(in);"),
    ]


def python_of(model: Any, trees: bool) -> dict[str, str]:
    """Modules of floats, by who writes them: each has `run(x)`, x a list of floats."""
    import m2cgen

    if trees:
        return {"m2cgen, floats": m2cgen.export_to_python(model) + "\ndef run(x):\n    return score(x)\n"}
    parts = Linear.of(model)
    values = tuple(float(c) for c in parts.coefficients)
    loops = (
        f"C = {values!r}\nT = {parts.terms!r}\nMEAN = {tuple(map(float, parts.mean))!r}\n"
        f"SCALE = {tuple(map(float, parts.scale))!r}\n\ndef run(x):\n    z = []\n"
        "    for i in range(len(x)):\n        z.append((x[i] - MEAN[i]) / SCALE[i])\n"
        f"    y = {parts.intercept!r}\n    for k in range(len(C)):\n        p = C[k]\n"
        "        for i in T[k]:\n            p *= z[i]\n        y += p\n    return y\n"
    )
    generated = (
        m2cgen.export_to_python(parts.model()) + parts.python() + "\ndef run(x):\n    return score(glue(x))\n"
    )
    return {"m2cgen, floats": generated, "by hand, floats": loops}
