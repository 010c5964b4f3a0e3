"""What making and verifying a signature costs: python -m tests.benchmarks signature

Times are the best of several turns. The probe's verifier (firmware_py/slh_dsa.py) is the same file in each
interpreter.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from firmware_py import signature, status
from palpate import models
from palpate.model_export.exporter import export
from palpate.model_export.signing import keys, slh_sign
from tests.micropython import run_micropython

TURNS = 9
HEAP = 1 << 22

SCRIPT = """
import gc
import time
from firmware_py import signature, slh_dsa
KEY = open("key", "rb").read()
DATA = open("image", "rb").read()
def read(at, n):
    return DATA[at : at + n]
def turn():
    began = time.ticks_us()
    assert signature.verify(KEY, read, len(DATA)) == 0
    print(time.ticks_diff(time.ticks_us(), began))
gc.collect()
gc.disable()
before = gc.mem_alloc()
turn()
print(gc.mem_alloc() - before)
"""


def best_ms(work: Callable[[], object], turns: int = TURNS) -> float:
    """Milliseconds of CPU of the best turn."""
    spent = []
    for _ in range(turns):
        began = time.process_time()
        work()
        spent.append(time.process_time() - began)
    return 1000 * min(spent)


def main() -> None:
    """Print the table of docs/model-image.md."""
    secret = slh_sign.Secret(bytes(16), bytes(range(16)), bytes(range(16, 32)))
    with tempfile.TemporaryDirectory() as scratch:
        home = Path(scratch) / "key"
        key = keys.generate(home, secret)
        image = export(models.load(models.BALLS), home)[0]

    def verify() -> None:
        assert signature.verify(key, lambda at, n: image[at : at + n], len(image)) == status.OK

    message = image[: len(image) - signature.size(key)]
    said = run_micropython(SCRIPT, {"key": key, "image": image}, heap=HEAP, turns=TURNS)
    _, allocated, *times_us = map(int, said.split())
    times = Table("what", "ms", title=f"SLH-DSA, an image of {len(image)} bytes")
    rows = {
        "a key, host": best_ms(lambda: slh_sign.public_key(secret)),
        "a signature, host": best_ms(lambda: slh_sign.sign(secret, key, message, signature.MODEL), 3),
        "verified, CPython": best_ms(verify),
        "verified, MicroPython/WASM": min(times_us) / 1000,
    }
    for what, ms in rows.items():
        times.add_row(what, f"{ms:.1f}")
    console = Console()
    console.print(times)
    console.print(f"garbage of one verification on MicroPython: {allocated} B")


if __name__ == "__main__":
    main()
