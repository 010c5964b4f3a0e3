"""Where the reference board's memory and start-up time go: a table by module and by object.

    PALPATE_RP2_UF2=... python -m tests.sim.probe.board_memory [--key PUBLIC_KEY --model IMAGE]

Each module is loaded after those that it needs, so that its line is its own; then the objects are made as
`rp2_reference.main` makes them. Bytes are counted after a collection, on the emulated board.
"""

from __future__ import annotations

import argparse
import ast
import tempfile
from pathlib import Path

from palpate.sim.probe.rp2040 import board_files
from palpate.sim.probe.rp2040.lean import lean
from tests.sim.probe import board_bench

_MEASURE = """
import gc, time, micropython
exec(open("loader.py").read())
def line(name, before, began):
    ms = time.ticks_diff(time.ticks_us(), began) / 1000
    gc.collect()
    print(name, before - gc.mem_free(), ms)
    return gc.mem_free()
gc.collect()
free = gc.mem_free()
print("heap", free, time.ticks_ms())
gc.threshold(32768)
for name in {modules}:
    began = time.ticks_us()
    __import__(name)
    if name == "firmware_py.memory":
        sys.modules[name].reserve()
    free = line(name, free, began)
from firmware_py import counters, outbox, results, wire, acquire, settings, messages, commands, handlers
from firmware_py import probe, stroke_state, calib, feature_chain, bins, pipeline
from firmware_py.boards import rp2_reference as board_module
gc.collect(); free = gc.mem_free(); began = time.ticks_us()
code = board_module._machine_code()
free = line("=machine_code", free, began); began = time.ticks_us()
from firmware_py.boards import links
box = outbox.Outbox(counters.fresh())
free = line("=(Outbox)", free, began); began = time.ticks_us()
r = results.Results(None, box, [], 0)
free = line("=(Results)", free, began)
box = r = None
gc.collect(); free = gc.mem_free(); began = time.ticks_us()
c = calib.Calibration()
free = line("=(Calibration)", free, began); began = time.ticks_us()
c = None
gc.collect(); free = gc.mem_free(); began = time.ticks_us()
from firmware_py import pipeline
p = pipeline.Pipeline(calib.Calibration())
free = line("=(Pipeline)", free, began)
from firmware_py import memory
memory._reserved.append(p.bins.cells)
p = None
gc.collect(); free = gc.mem_free(); began = time.ticks_us()
try:
    board = board_module.Board(links.UsbLink())
    micropython.kbd_intr(3)
    free = line("=Board", free, began); began = time.ticks_us()
    key = board.store.read("key.pub", 0, 64)
    from firmware_py import flash, estimator
    f = flash.Flash(board.store, key) if key else None
    free = line("=Flash", free, began); began = time.ticks_us()
    estimates = estimator.Estimator(board.store, f)
    free = line("=Estimator", free, began); began = time.ticks_us()
except Exception as e:
    micropython.kbd_intr(3)
    print("= =", repr(e))
    micropython.qstr_info()
    micropython.mem_info()
p = probe.Probe(board, estimates)
free = line("=Probe", free, began)
print("=", gc.mem_free(), "=")
micropython.qstr_info()
micropython.mem_info()
"""


def in_order(sources: dict[str, str], main: str) -> list[str]:
    """Every module after those that it imports at its top."""
    done: list[str] = []

    def visit(path: str) -> None:
        name = "firmware_py." + path.removesuffix(".py").replace("/", ".")
        name = name.removesuffix(".__init__")
        if path not in sources or name in done:
            return
        for node in ast.parse(sources[path]).body:
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("firmware_py"):
                folder = (node.module or "").partition(".")[2]
                for alias in node.names:
                    visit(f"{folder}/{alias.name}.py" if folder else f"{alias.name}.py")
        if name not in done:
            done.append(name)

    visit("__init__.py")
    visit("memory.py")
    visit("boards/__init__.py")
    visit("boards/rp2_reference.py")
    return done


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--key", type=Path)
    parser.add_argument("--model", type=Path)
    args = parser.parse_args()
    files = dict(board_bench.firmware())
    text = files.pop("main.py").decode()
    loader = text.partition("from firmware_py.boards import rp2_reference")[0]
    names = board_files.modules()
    sources = lean({name: (board_files.FIRMWARE / name).read_text() for name in names}, text)
    more = {"main.py": b"", "loader.py": loader.encode()}
    if args.key:
        more["key.pub"] = args.key.read_bytes()
    if args.model:
        with tempfile.TemporaryDirectory() as folder:
            more |= board_bench.kept_files(Path(folder), args.model.read_bytes())
    board = board_bench.Board(more)
    board.chip.run(lambda: board.chip.connected)
    print(board.chip.execute(_MEASURE.format(modules=in_order(sources, text)), 60e6))


if __name__ == "__main__":
    main()
