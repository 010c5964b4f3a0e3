"""Signed images: their sizes, and what making and verifying a signature costs.

    python -m tests.benchmarks.bench_signature

Times are of CPU, the best of several turns. The probe's verifier (firmware_py/slh_dsa.py) is the same file in
each interpreter; MicroPython's Unix port is timed where `micropython` is on the PATH.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from firmware_py import signature, status
from palpate import models as bundled
from palpate.model_export.exporter import export
from palpate.model_export.signing import keys, slh_sign
from palpate.sim.probe import node
from tests.micropython import FIRMWARE, run_micropython, stage
from tests.model_export import synthetic

TURNS = 9
HEAP = 1 << 22

SETUP = """
import gc
from firmware_py import signature, slh_dsa
KEY = open("key", "rb").read()
DATA = open("image", "rb").read()
def read(at, n):
    return DATA[at : at + n]
def verify():
    assert signature.verify(KEY, read, len(DATA)) == 0
def turn(name):
    if name == "verify":
        verify()
"""

ALLOCATED = """
gc.collect()
gc.disable()
before = gc.mem_alloc()
verify()
print(gc.mem_alloc() - before)
"""

CLOCK = """
import time
best = 1 << 29
for _ in range(%d):
    t = time.ticks_us()
    verify()
    best = min(best, time.ticks_diff(time.ticks_us(), t))
print(best / 1000)
"""


def best_ms(work: Callable[[], object], turns: int = TURNS) -> float:
    """Milliseconds of CPU of the best turn."""
    spent = []
    for _ in range(turns):
        began = time.process_time()
        work()
        spent.append(time.process_time() - began)
    return 1000 * min(spent)


def on_wasm(files: dict[str, bytes]) -> float:
    """Milliseconds of CPU of a verification on MicroPython/WASM."""
    node.check_wasm()
    with tempfile.TemporaryDirectory() as scratch:
        config = stage(Path(scratch), SETUP + 'NAMES = "nothing verify"\n', files, HEAP, turns=TURNS)
        command = [node.node(), str(Path(__file__).with_name("turns.mjs")), str(config)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)
    best = json.loads(done.stdout.splitlines()[-1])
    return (best["verify"] - best["nothing"]) / 1000


def on_unix(files: dict[str, bytes]) -> float | None:
    """Milliseconds of a verification on MicroPython's Unix port; None where there is none."""
    program = shutil.which("micropython")
    if program is None:
        return None
    with tempfile.TemporaryDirectory() as scratch:
        for name, data in files.items():
            (Path(scratch) / name).write_bytes(data)
        where = f"import sys\nsys.path.insert(0, {str(FIRMWARE.parent)!r})\n"
        done = subprocess.run(
            [program, "-X", f"heapsize={HEAP}", "-c", where + SETUP + CLOCK % TURNS],
            cwd=scratch, capture_output=True, text=True, timeout=600, check=True,
        )  # fmt: skip
    return float(done.stdout)


def main() -> None:
    """Print the tables of docs/model-image.md, "The signature"."""
    console = Console()
    secret = slh_sign.Secret(bytes(16), bytes(range(16)), bytes(range(16, 32)))
    with tempfile.TemporaryDirectory() as scratch:
        home = Path(scratch) / "key"
        key = keys.generate(home, secret)
        models = {
            "thesis": synthetic.model("thesis"),
            "field": synthetic.model("field"),
            **{f"{name}, comes with Palpate": bundled.load(name) for name in bundled.NAMES},
        }
        images = {f"{name}, {len(spec.terms)} terms": export(spec, home)[0] for name, spec in models.items()}
    sizes = Table("model", "its part, B", "signature, B", "image, B", title="Signed images")
    for name, image in images.items():
        signed = signature.size(key)
        sizes.add_row(name, str(len(image) - signed), str(signed), str(len(image)))
    console.print(sizes)
    image = max(images.values(), key=len)

    def verify() -> None:
        assert signature.verify(key, lambda at, n: image[at : at + n], len(image)) == status.OK

    message = image[: len(image) - signature.size(key)]
    files = {"key": key, "image": image}
    unix_ms = on_unix(files)
    allocated = int(run_micropython(SETUP + ALLOCATED, files, heap=HEAP))
    times = Table("what", "ms of CPU", title=f"SLH-DSA, an image of {len(image)} bytes")
    rows = {
        "a key, host": best_ms(lambda: slh_sign.public_key(secret)),
        "a signature, host": best_ms(lambda: slh_sign.sign(secret, key, message, signature.MODEL), 3),
        "verified, CPython": best_ms(verify),
        "verified, MicroPython/WASM": on_wasm(files),
        "verified, MicroPython, Unix port": unix_ms,
    }
    for what, ms in rows.items():
        times.add_row(what, "no micropython on the PATH" if ms is None else f"{ms:.1f}")
    console.print(times)
    console.print(f"garbage of one verification on MicroPython: {allocated} B")


if __name__ == "__main__":
    main()
