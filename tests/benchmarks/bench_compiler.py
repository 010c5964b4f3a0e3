"""A regression of anybody's on a microcontroller, beside other tools: python -m tests.benchmarks compiler

    PALPATE_RP2_UF2=... python -m tests.benchmarks.bench_compiler [python | c]

`c`: cycles of a Cortex-M0+ without wait states (cortex_m0.py), floats by libgcc; bytes of code and constants,
with what comes from libraries. `python`: cycles of an emulated RP2040 under MicroPython's own port; bytes of
the .mpy. The error is what compiling adds to float64's prediction: the worst of 50 rows (10 in Python), in
standard deviations of the target.
"""

from __future__ import annotations

import math
import sys
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from sklearn.datasets import load_diabetes, make_friedman1, make_friedman2, make_friedman3
from sklearn.ensemble import RandomForestRegressor
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from palpate import models
from palpate.fixedpoint import Program, from_sklearn, mpy
from palpate.model_export.integers import reference, sampling
from tests.benchmarks import cortex_m0
from tests.benchmarks.peers import compiled

CYCLES_A_US = 125
ROWS_C, ROWS_PYTHON = 50, 10
TIMED = """
import gc, sys, time
sys.path.insert(0, "")
import {module} as model
rows = {rows}
out = [0] * {size}
{run}
gc.collect()
found = []
start = time.ticks_us()
for row in rows:
    found.append(run(row))
print(time.ticks_diff(time.ticks_us(), start))
for value in found:
    print(value)
"""
INTEGERS = "def run(x):\n    model.predict(x, out)\n    return out[0]"


@dataclass(frozen=True)
class Case:
    """A fitted model, its program, and rows to try.

    Attributes
    ----------
    reference : array (n,)
        What the model itself says of X.
    spread : float
        The target's standard deviation.
    """

    name: str
    model: Any
    program: Program
    X: np.ndarray
    reference: np.ndarray
    spread: float

    @property
    def trees(self) -> bool:
        """Whether it is a forest."""
        return isinstance(self.model, RandomForestRegressor)


def houses(n: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    """Made up, as California's houses are: incomes, ages, rooms, people, places; skewed, of many scales."""
    rng = np.random.default_rng(5)
    income, rooms, people = (rng.lognormal(m, s, n) for m, s in ((1.2, 0.45), (1.65, 0.25), (1.0, 0.25)))
    age, block, south, west = (rng.uniform(a, b, n) for a, b in ((1, 52), (3, 6000), (32.5, 42), (114, 124)))
    beds = rooms * rng.normal(0.2, 0.02, n)
    y = 0.4 * income + 0.01 * age - 0.3 * np.log(people) + 0.2 * np.sin(south) * np.cos(west)
    return np.c_[income, age, rooms, beds, block, people, south, west], y + 0.1 * rng.normal(size=n)


def probe(n: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """What our model `field` says of a lump's diameter for features of its domain: 24 of them."""
    spec = models.load("field")
    X = sampling.in_domain(spec, n)
    return X, reference.evaluate(spec, X)["value"][:, 2]


DATA = {
    "diabetes": lambda: load_diabetes(return_X_y=True),
    "houses": houses,
    "Friedman 1": lambda: make_friedman1(500, random_state=0),
    "Friedman 2": lambda: make_friedman2(500, random_state=0),
    "Friedman 3": lambda: make_friedman3(500, random_state=0),
    "field, d": probe,
}


def cases() -> list[Case]:
    """Polynomials of degree 2 on every set of data, and a forest on one of them."""
    found = []
    for name in (*DATA, "Friedman 1, forest"):
        X, y = DATA[name.removesuffix(", forest")]()
        model: Any = make_pipeline(StandardScaler(), PolynomialFeatures(2), Ridge(0.1))
        if name.endswith("forest"):
            model = RandomForestRegressor(10, max_depth=6, random_state=0)
        model.fit(X, y)
        program = from_sklearn(model, X)
        # all begin with the value that the device's integer stands for
        tried = program.quantised(X[:ROWS_C]) * np.array([f.step for f in program.features])
        found.append(Case(name, model, program, tried, model.predict(tried), float(np.std(y))))
    return found


def in_c(case: Case) -> list[tuple[str, str, str, str]]:
    """Contender, error, bytes and cycles of each."""
    rows = []
    others = compiled.trees_in_c(case.model) if case.trees else compiled.linear_in_c(case.model)
    for make in (lambda: compiled.ours(case.program), *others):
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            contender = make()
            try:
                program = cortex_m0.Program(
                    Path(folder), f"model.{contender.suffix}", contender.source, contender.include
                )
            except cortex_m0.Unbuildable as error:
                rows.append((contender.name, str(error), "", ""))
                continue
            given = case.program.quantised(case.X) if contender.given == "<i4" else case.X
            said, cycles = [], 0
            for row in given:
                size = np.dtype(contender.gives).itemsize
                out = program.run("once", {"in": row.astype(contender.given).tobytes()}, "out", size)
                said.append(float(np.frombuffer(out, contender.gives)[0]) * contender.step)
                cycles += program.cycles
            rows.append(
                (contender.name, *_told(said, case), f"{program.size:,}", f"{cycles / len(said):,.0f}")
            )
    return rows


def _told(said: list[float], case: Case) -> tuple[str]:
    away = np.abs(np.array(said) - case.reference[: len(said)]).max()
    return (f"{away / case.spread:.0e}",)


def in_python(case: Case) -> list[tuple[str, str, str, str]]:
    """Likewise under MicroPython, each on a board that was just switched on."""
    values = case.X[:ROWS_PYTHON]
    integers = case.program.quantised(values).tolist()
    step = case.program.outputs[0].step
    modules = {
        "palpate, bytecode": (case.program.mpy(), integers, INTEGERS, step),
        "palpate, machine code": (case.program.mpy("armv6m"), integers, INTEGERS, step),
    }
    for name, text in compiled.python_of(case.model, case.trees).items():
        modules[name] = (mpy.compiled(text, "model.py"), values.tolist(), "run = model.run", 1.0)
    rows = []
    for name, (code, given, run, unit) in modules.items():
        said, us = on_the_board(code, given, run, len(case.program.outputs))
        if not said:
            rows.append((name, "its memory is too small", f"{len(code):,}", ""))
            continue
        cycles = f"{us * CYCLES_A_US / len(given):,.0f}"
        rows.append((name, *_told([v * unit for v in said], case), f"{len(code):,}", cycles))
    return rows


def on_the_board(code: bytes, given: list[Any], run: str, size: int) -> tuple[list[float], int]:
    """What it says, and microseconds; nothing where the board's memory is too small."""
    from palpate.sim.probe.rp2040 import flash, interpreter
    from palpate.sim.probe.rp2040.chip import Chip, Dead

    chip = Chip(interpreter.find(), flash.image({"measured.mpy": code}))
    chip.run(lambda: chip.connected)
    script = TIMED.format(module="measured", rows=given, size=size, run=run)
    try:
        us, *said = chip.execute(script, 60e6).split()
    except Dead as error:
        if "MemoryError" in str(error):
            return [], 0
        raise
    return [float(v) for v in said], int(us)


def main() -> None:
    """Print the tables of docs/performance.md."""
    wanted = [w for w in sys.argv[1:] if w in ("python", "c")] or ["c", "python"]
    console = Console(width=110)
    found = cases()
    for how, measure in (("c", in_c), ("python", in_python)):
        if how not in wanted:
            continue
        table = Table("model", "contender", "error added", "bytes", "cycles", "times ours", title=how)
        for case in found:
            rows = measure(case)
            first = float(rows[0][3].replace(",", "") or "nan")
            for name, error, size, cycles in rows:
                ratio = float(cycles.replace(",", "")) / first if cycles else math.nan
                table.add_row(case.name, name, error, size, cycles, f"{ratio:.1f}" if cycles else "")
            table.add_section()
        console.print(table)


if __name__ == "__main__":
    main()
