"""The model's sums as emlearn writes them: C, compiled for this machine."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import tempfile
import warnings
from pathlib import Path

import numpy as np

from palpate.model_export.fixed_point import reference, sampling
from palpate.model_export.schema import ModelSpec

_MAIN = """
#include <stdio.h>
#include <time.h>
#include "model.h"
static const float inputs[%d][%d] = {%s};
int main(void) {
    float out[OUTPUTS];
    struct timespec a, b;
    for (int i = 0; i < %d; i++) {
        model_regress(inputs[i], %d, out, OUTPUTS);
        for (int j = 0; j < OUTPUTS; j++) printf("%%.9g ", out[j]);
        printf("\\n");
    }
    clock_gettime(CLOCK_MONOTONIC, &a);
    for (int r = 0; r < 200000; r++) model_regress(inputs[r %% %d], %d, out, OUTPUTS);
    clock_gettime(CLOCK_MONOTONIC, &b);
    printf("%%.9g\\n", ((b.tv_sec - a.tv_sec) * 1e9 + (b.tv_nsec - a.tv_nsec)) / 200000);
    return 0;
}
"""


def native(spec: ModelSpec, vectors: int) -> tuple[float, float] | str:
    """What emlearn makes of the regressions over the monomials (a network of identities), natively.

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
    terms, outputs = spec.terms[1:], len(spec.outputs)
    network = MLPRegressor(hidden_layer_sizes=(outputs,), activation="identity", max_iter=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        network.fit(rng.normal(size=(50, len(terms))), rng.normal(size=(50, outputs)))
    network.coefs_ = [np.array([o.coefficients[1:] for o in spec.outputs]).T, np.eye(outputs)]
    network.intercepts_ = [np.array([o.coefficients[0] for o in spec.outputs]), np.zeros(outputs)]
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
        command = [
            "cc",
            "-O2",
            f"-DOUTPUTS={outputs}",
            "-o",
            "main",
            "main.c",
            "-lm",
            f"-I{emlearn.includedir}",
        ]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        said = subprocess.run([str(folder / "main")], check=True, capture_output=True, text=True).stdout
    lines = said.splitlines()
    got = np.array([[float(v) for v in line.split()] for line in lines[:-1]])
    is_ln = np.array([o.link == "ln" for o in spec.outputs])
    size = np.where(is_ln, 1.0, np.maximum(np.abs(exact), 0.1))
    return float(lines[-1]) / 1e3, float(np.max(np.abs(got - exact) / size))
