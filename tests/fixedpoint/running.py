"""Programs as the device runs them: real MicroPython, and C compiled for this machine."""

from __future__ import annotations

import ctypes
import json
import subprocess
from pathlib import Path

import numpy as np

from palpate.fixedpoint import Program, ir
from tests.micropython import run_micropython

_SCRIPT = """
import json, sys
sys.path.insert(0, '')
import model
out = [0] * model.SIZE
answers = []
for row in json.loads(open('vectors.json').read()):
    model.predict(row, out)
    answers.append(list(out))
print(json.dumps(answers))
"""
_LOOP = """
void all(const int32_t *x, int32_t *out, int n)
{
    for (int i = 0; i < n; i++) predict(x + PREDICT_FEATURES * i, out + PREDICT_OUTPUTS * i);
}
"""


def vectors(program: Program, X: np.ndarray | None = None, n: int = 40) -> np.ndarray:
    """Integers to try: of the data, of the box with its corners, and whatever fits 30 bits."""
    rng = np.random.default_rng(1)
    some = [program.quantised(program.box(n)), rng.integers(-(2**29), 2**29, (n, len(program.features)))]
    return np.vstack([program.quantised(X)[:n], *some] if X is not None else some)


def numpy(program: Program, x: np.ndarray) -> list[list[int]]:
    """What `predict` gives, of integers."""
    return program.code.run(x, len(program.outputs)).tolist()


def micropython(program: Program, x: np.ndarray, arch: str | None = None) -> list[list[int]]:
    """What the module gives on MicroPython, as source, or compiled."""
    files = {"vectors.json": json.dumps(x.tolist()).encode()}
    if arch is None:
        files["model.py"] = program.python().encode()
    else:
        files["model.mpy"] = program.mpy(arch)
    return json.loads(run_micropython(_SCRIPT, files))


def c(program: Program, x: np.ndarray, folder: Path) -> list[list[int]]:
    """What the header gives, compiled by a compiler that warns of all and traps what C leaves undefined."""
    (folder / "model.c").write_text(program.c() + _LOOP)
    options = "-std=c99 -Wall -Wextra -Werror -pedantic -O1 -fsanitize=undefined -fno-sanitize-recover"
    library = folder / "model.so"
    command = ["gcc", *options.split(), "-shared", "-fPIC", "-o", str(library), str(folder / "model.c")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    x = np.ascontiguousarray(x, np.int32)
    out = np.zeros((len(x), len(program.outputs)), np.int32)
    pointer = ctypes.c_void_p
    ctypes.CDLL(str(library)).all(x.ctypes.data_as(pointer), out.ctypes.data_as(pointer), len(x))
    return out.tolist()


class _Largest(ir._Columns):
    """Runs on columns and keeps the largest magnitude of any intermediate, also inside sums of products."""

    largest = 0

    def value(self, of: ir.Node):
        if of.op == "dot":
            total = ir.node(0)
            for k, name in zip(*of.args):
                total = ir.Node("+", total, ir.Node("*", ir.node(k), ir.var(name)))
            of = total
        found = super().value(of)
        if of.op in ("var", "number"):  # a feature is whatever it is
            return found
        self.largest = max(self.largest, int(np.abs(found).max()))
        return found


def largest(program: Program, x: np.ndarray) -> int:
    """The largest magnitude that any intermediate has for the integers x."""
    env: dict = {f"x[{i}]": x[:, i] for i in range(x.shape[1])}
    walk = _Largest(program.code, env, x)
    for let in program.code.lets:
        env[let.name] = walk.value(let.value)
    return walk.largest


def worst(program: Program) -> float:
    """The worst error over the data (or the box, where there are none), in standard deviations."""
    found = [e for e in program.errors if e.over == "X"] or program.errors
    return max(e.worst / e.spread for e in found)
