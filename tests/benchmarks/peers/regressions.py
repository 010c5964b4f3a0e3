"""The model as other tools write it: float Python by hand, m2cgen's Python with its glue, emlearn's C.

"Values" are the five outputs; "whole" is values, intervals, domain, hardness and force range. All of
them begin with the features as the firmware has them, integers in Q24, hold them to the clip box and hold
the predictions to their ends, as the model says. The float tables leave out the ranges that the model is for.
"""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from palpate.model_export.fixed_point import reference, sampling
from palpate.model_export.schema import ModelSpec

_TABLES = """
import math

def whole(x):
    z = []
    for i in range(N):
        v = x[i] / 16777216
        if v < LO[i]:
            v = LO[i]
        elif v > HI[i]:
            v = HI[i]
        z.append((v - CENTRE[i]) / SCALE[i])
    m = []
    for t in TERMS:
        p = 1.0
        for i in t:
            p *= z[i]
        m.append(p)
    ys = []
    for j in range(5):
        c = COEFFICIENTS[j]
        y = 0.0
        for k in range(len(m)):
            y += c[k] * m[k]
        ys.append(min(max(y, YLO[j]), YHI[j]))
    values = [math.exp(ys[j]) if LN[j] else ys[j] for j in range(5)]
    hard = values[4] < HARD
    s_in = [1.0] + z + ys
    out = []
    for j in range(5):
        c = SIGMA[j]
        s = 0.0
        for k in range(len(s_in)):
            s += c[k] * s_in[k]
        w = QUANTILES[j][hard] * math.exp(s)
        lo = max(ys[j] - w, YLO[j])
        hi = min(ys[j] + w, YHI[j])
        out.append((values[j], math.exp(lo) if LN[j] else lo, math.exp(hi) if LN[j] else hi))
    d = 0.0
    for i in range(N):
        p = PRECISION[i]
        s = 0.0
        for k in range(N):
            s += p[k] * z[k]
        d += s * z[i]
    inside = d <= THRESHOLD
    for i in range(N):
        if not BOX_LO[i] <= x[i] <= BOX_HI[i]:
            inside = False
    return out, inside, hard
"""


def _scaled(values: Sequence[float]) -> list[int]:
    return [round(v * 2**24) for v in values]


def _ends(spec: ModelSpec) -> list[tuple[float, float]]:
    """Range of each prediction, on its link scale."""
    return [
        (float(np.log(o.lo)), float(np.log(o.hi))) if o.link == "ln" else (o.lo, o.hi) for o in spec.outputs
    ]


def float_module(spec: ModelSpec) -> str:
    """The model as plain float Python, tables and loops, as one would write it: `whole(x)`."""
    ends = _ends(spec)
    names = {
        "N": len(spec.features),
        "LO": spec.clip_lo,
        "HI": spec.clip_hi,
        "CENTRE": spec.centre,
        "SCALE": spec.scale,
        "TERMS": spec.terms,
        "COEFFICIENTS": tuple(o.coefficients for o in spec.outputs),
        "LN": [o.link == "ln" for o in spec.outputs],
        "YLO": [lo for lo, _ in ends],
        "YHI": [hi for _, hi in ends],
        "HARD": spec.hard_below,
        "SIGMA": spec.interval.coefficients,
        "QUANTILES": spec.interval.quantiles,
        "PRECISION": spec.domain.precision,
        "THRESHOLD": spec.domain.threshold,
        "BOX_LO": _scaled(spec.domain.lo),
        "BOX_HI": _scaled(spec.domain.hi),
    }
    return "".join(f"{name} = {value!r}\n" for name, value in names.items()) + _TABLES


def _clipped(name: str, lo: float, hi: float) -> Iterator[str]:
    yield f"    if {name} < {lo!r}:"
    yield f"        {name} = {lo!r}"
    yield f"    elif {name} > {hi!r}:"
    yield f"        {name} = {hi!r}"


class _M2cgen:
    """m2cgen writes the linear functions, over lists; the rest is the least glue to a model."""

    def __init__(self, spec: ModelSpec) -> None:
        self.spec = spec
        self.n = len(spec.features)
        self.ln = [o.link == "ln" for o in spec.outputs]
        self.ends = _ends(spec)

    def linear(self, name: str, coefficients: Sequence[float], intercept: float) -> str:
        import m2cgen
        from sklearn.linear_model import LinearRegression

        model = LinearRegression()
        model.coef_ = np.array(coefficients, float)
        model.intercept_ = float(intercept)
        return str(m2cgen.export_to_python(model, function_name=name))

    def functions(self) -> Iterator[str]:
        spec = self.spec
        for j, output in enumerate(spec.outputs):
            assert spec.terms[0] == () and spec.interval.terms == ((), *((i,) for i in range(self.n)))
            yield self.linear(f"score{j}", output.coefficients[1:], output.coefficients[0])
            row = spec.interval.coefficients[j]
            yield self.linear(f"spread{j}", row[1:], row[0])
        lower = np.linalg.cholesky(np.array(spec.domain.precision)[::-1, ::-1]).T[::-1, ::-1]
        lower /= np.sqrt(spec.domain.threshold)
        for i, away in enumerate(-lower @ np.array(spec.domain.centre)):
            yield self.linear(f"axis{i}", lower[i][: i + 1], away)

    def predictions(self) -> Iterator[str]:
        spec = self.spec
        for i in range(self.n):
            yield f"    v = x[{i}] / 16777216"
            yield from _clipped("v", spec.clip_lo[i], spec.clip_hi[i])
            yield f"    z{i} = (v - {spec.centre[i]!r}) / {spec.scale[i]!r}"
        yield f"    m = [{', '.join(' * '.join(f'z{i}' for i in term) for term in spec.terms[1:])}]"
        for j in range(5):
            yield f"    y{j} = score{j}(m)"
            yield from _clipped(f"y{j}", *self.ends[j])

    def ranges(self) -> Iterator[list[str]]:
        """For each output what makes it lie beyond the range that the model is for."""
        margin = self.spec.domain.margin
        for j, (lo, hi) in enumerate(self.spec.domain.ranges):
            ends = [v if v is None or not self.ln[j] else float(np.log(v)) for v in (lo, hi)]
            below = [f"{ends[0]!r} - y{j} > {margin!r} * w{j}"] if ends[0] is not None else []
            yield below + ([f"y{j} - {ends[1]!r} > {margin!r} * w{j}"] if ends[1] is not None else [])

    def linked(self, y: str, j: int) -> str:
        return f"math.exp({y})" if self.ln[j] else y

    def values(self) -> Iterator[str]:
        yield "def values(x):"
        yield from self.predictions()
        yield f"    return {', '.join(self.linked(f'y{j}', j) for j in range(5))}"

    def estimate(self) -> Iterator[str]:
        spec = self.spec
        features = ", ".join(f"z{i}" for i in range(self.n))
        yield "def estimate(x):"
        yield from self.predictions()
        yield from (f"    v{j} = {self.linked(f'y{j}', j)}" for j in range(5))
        yield f"    hard = v4 < {spec.hard_below!r}"
        yield f"    m = [{features}, y0, y1, y2, y3, y4]"
        for j in range(5):
            soft, hard = spec.interval.quantiles[j]
            lo, hi = self.ends[j]
            yield f"    w{j} = math.exp(spread{j}(m)) * ({hard!r} if hard else {soft!r})"
            yield f"    l{j} = y{j} - w{j}"
            yield f"    if l{j} < {lo!r}:"
            yield f"        l{j} = {lo!r}"
            yield f"    h{j} = y{j} + w{j}"
            yield f"    if h{j} > {hi!r}:"
            yield f"        h{j} = {hi!r}"
            yield f"    l{j} = {self.linked(f'l{j}', j)}"
            yield f"    h{j} = {self.linked(f'h{j}', j)}"
        yield f"    m = [{features}]"
        yield "    d = 0.0"
        for i in range(self.n):
            yield f"    w = axis{i}(m)"
            yield "    d += w * w"
        yield "    inside = d <= 1"
        for i, (lo, hi) in enumerate(zip(_scaled(spec.domain.lo), _scaled(spec.domain.hi))):
            yield f"    if x[{i}] < {lo} or x[{i}] > {hi}:"
            yield "        inside = False"
        for far in self.ranges():
            if far:
                yield f"    if {' or '.join(far)}:"
                yield "        inside = False"
        all_of_it = ", ".join(f"v{j}, l{j}, h{j}" for j in range(5))
        yield f"    force = {spec.force_range[0]!r} <= v0 <= {spec.force_range[1]!r}"
        yield f"    return {all_of_it}, inside, h4 < {spec.hard_below!r}, l4 >= {spec.hard_below!r}, force, d"


def m2cgen_module(spec: ModelSpec) -> str | None:
    """m2cgen's Python: `values(x)` and `estimate(x)`; None where it is not installed."""
    try:
        import m2cgen  # noqa: F401
    except ImportError:
        return None
    writer = _M2cgen(spec)
    return "\n".join(["import math", *writer.functions(), *writer.values(), "", *writer.estimate(), ""])


_MAIN = """
#include <stdio.h>
#include <time.h>
#include "model.h"
static const float inputs[%d][%d] = {%s};
int main(void) {
    float out[5];
    struct timespec a, b;
    for (int i = 0; i < %d; i++) {
        model_regress(inputs[i], %d, out, 5);
        printf("%%.9g %%.9g %%.9g %%.9g %%.9g\\n", out[0], out[1], out[2], out[3], out[4]);
    }
    clock_gettime(CLOCK_MONOTONIC, &a);
    for (int r = 0; r < 200000; r++) model_regress(inputs[r %% %d], %d, out, 5);
    clock_gettime(CLOCK_MONOTONIC, &b);
    printf("%%.9g\\n", ((b.tv_sec - a.tv_sec) * 1e9 + (b.tv_nsec - a.tv_nsec)) / 200000);
    return 0;
}
"""


def emlearn_native(spec: ModelSpec, vectors: int) -> tuple[float, float] | str:
    """What emlearn makes of the five regressions over the monomials (a network of identities), natively.

    Returns (microseconds for the sums alone, worst error against float64), or why there is none. emlearn
    makes C, which the WASM port cannot load: it is compiled for this machine.
    """
    try:
        import emlearn
        from sklearn.neural_network import MLPRegressor
    except ImportError:
        return "not installed"
    if shutil.which("cc") is None:
        return "there is no C compiler here"
    rng = np.random.default_rng(1)
    terms = spec.terms[1:]
    network = MLPRegressor(hidden_layer_sizes=(5,), activation="identity", max_iter=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        network.fit(rng.normal(size=(50, len(terms))), rng.normal(size=(50, 5)))
    network.coefs_ = [np.array([o.coefficients[1:] for o in spec.outputs]).T, np.eye(5)]
    network.intercepts_ = [np.array([o.coefficients[0] for o in spec.outputs]), np.zeros(5)]
    features = sampling.in_domain(spec, vectors)
    z = (np.clip(features, spec.clip_lo, spec.clip_hi) - spec.centre) / spec.scale
    inputs = reference.monomials(z, terms)
    exact = reference.monomials(z, spec.terms) @ np.array([o.coefficients for o in spec.outputs]).T
    rows = ",".join("{" + ",".join(f"{v:.9g}" for v in row) + "}" for row in inputs)
    n, k = inputs.shape
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory)
        with contextlib.chdir(folder):  # it builds a wrapper in ./tmp
            emlearn.convert(network, method="loadable", return_type="regressor").save(
                name="model", file="model.h"
            )
        (folder / "main.c").write_text(_MAIN % (n, k, rows, n, k, n, k))
        command = ["cc", "-O2", "-o", "main", "main.c", "-lm", f"-I{emlearn.includedir}"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        said = subprocess.run([str(folder / "main")], check=True, capture_output=True, text=True).stdout
    lines = said.splitlines()
    got = np.array([[float(v) for v in line.split()] for line in lines[:-1]])
    is_ln = np.array([o.link == "ln" for o in spec.outputs])
    size = np.where(is_ln, 1.0, np.maximum(np.abs(exact), 0.1))
    return float(lines[-1]) / 1e3, float(np.max(np.abs(got - exact) / size))
