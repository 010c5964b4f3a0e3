"""The model as other tools write it in Python: floats by hand, m2cgen's with its glue (emlearn_c.py has C).

"Values" are the outputs; "whole" is values, intervals, domain, hardness and force range. All of
them begin with the features as the firmware has them, integers in Q24, hold them to the clip box and hold
the predictions to their ends, as the model says. The float tables leave out the ranges that the model is for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

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
    for j in range(len(COEFFICIENTS)):
        c = COEFFICIENTS[j]
        y = 0.0
        for k in range(len(m)):
            y += c[k] * m[k]
        ys.append(min(max(y, YLO[j]), YHI[j]))
    values = [math.exp(ys[j]) if LN[j] else ys[j] for j in range(len(COEFFICIENTS))]
    hard = values[4] < HARD
    s_in = [1.0] + z + ys
    out = []
    for j in range(len(COEFFICIENTS)):
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
        self.outputs = range(len(spec.outputs))
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
        for j in self.outputs:
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
        yield f"    return {', '.join(self.linked(f'y{j}', j) for j in self.outputs)}"

    def estimate(self) -> Iterator[str]:
        spec = self.spec
        features = ", ".join(f"z{i}" for i in range(self.n))
        yield "def estimate(x):"
        yield from self.predictions()
        yield from (f"    v{j} = {self.linked(f'y{j}', j)}" for j in self.outputs)
        yield f"    hard = v4 < {spec.hard_below!r}"
        yield f"    m = [{features}, {', '.join(f'y{j}' for j in self.outputs)}]"
        for j in self.outputs:
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
        all_of_it = ", ".join(f"v{j}, l{j}, h{j}" for j in self.outputs)
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
