"""Where the reference board's memory and its start-up time go: a table by parts of the firmware.

    python -m tests.sim.probe.board_memory [--key public.key --model IMAGE]

On the emulated RP2040, in device time. Each module is loaded after those that it needs, so that its bytes are
its own; then the objects are made in the order of `rp2_reference.main`. Bytes are counted after a collection.
"""

from __future__ import annotations

import argparse
import ast
import tempfile
from collections import defaultdict
from pathlib import Path

from rich.console import Console
from rich.table import Table

from palpate.sim.probe.rp2040 import board_files
from palpate.sim.probe.rp2040.chip import Dead
from palpate.sim.probe.rp2040.lean import lean
from palpate.sim.probe.rp2040.names import borrowed
from tests.sim.probe import board_bench

_PROGRAM = """
import gc, sys, time, micropython
gc.collect()
free = gc.mem_free()
began = time.ticks_us()
def line(name):
    global free, began
    us = time.ticks_diff(time.ticks_us(), began)
    gc.collect()
    print(name, free - gc.mem_free(), us)
    free = gc.mem_free()
    began = time.ticks_us()
line("nothing")
for module in MODULES:
    __import__(module)
    if module == "firmware_py.memory":
        sys.modules[module].reserve()
    line(module)
from firmware_py import estimator, flash, probe, store
from firmware_py.boards import links, rp2_reference
line("nothing")
rp2_reference._machine_code()
line("machine_code")
link = links.UsbLink()
micropython.kbd_intr(3)
board = rp2_reference.Board(link)
line("Board")
key = board.store.read("key.pub", 0, 64)
flashing = flash.Flash(board.store, key) if key else None
line("Flash")
made = estimator.Estimator(board.store, flashing)
line("Estimator")
made = probe.Probe(board, made)
line("Probe")
print("free", gc.mem_free(), 0)
micropython.mem_info()
"""
_PARTS = {
    "the pipeline": "bins calib columns feature_chain features fixed forcemap gauss gaussfit geometry "
    "pipeline profile search stuck traces",
    "the model": "constant evaluator polynomial scales verdict",
    "flashing and the store": "flash keyring live_model safe_record slots store",
    "checking a model, calibrating (given back)": "calibrate model_check model_image slh_dsa unpack",
    "link and messages": "cobs counters crc messages outbox tables wire",
    "commands, strokes, results": "acquire commands estimator handlers probe results settings stream "
    "stroke_state",
    "the cells' block": "memory",
}


def in_order(sources: dict[str, str]) -> list[str]:
    """Every module after those that it imports at its top."""
    done: list[str] = []

    def visit(path: str) -> None:
        name = f"firmware_py.{path.removesuffix('.py').replace('/', '.')}".removesuffix(".__init__")
        if path not in sources or name in done:
            return
        for node in ast.parse(sources[path]).body:
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("firmware_py"):
                folder = (node.module or "").partition(".")[2]
                for alias in node.names:
                    visit(f"{folder}/{alias.name}.py" if folder else f"{alias.name}.py")
        done.append(name)

    for path in ("__init__.py", "memory.py", "boards/__init__.py", "boards/rp2_reference.py"):
        visit(path)
    return done


def measured(more: dict[str, bytes]) -> list[tuple[str, int, int]]:
    """Name, bytes and microseconds of each line that the board prints."""
    main = board_bench.firmware()["main.py"].decode()
    loader = main.partition("from firmware_py.boards import rp2_reference")[0]
    texts = {name: (board_files.FIRMWARE / name).read_text() for name in board_files.modules()}
    sources = lean(texts, main)
    modules = in_order(sources)
    renamed = borrowed({**sources, "program.py": f"MODULES = {modules}\n{_PROGRAM}"})
    program = renamed.pop("program.py")
    codes = {name: board_files.compiled(name, text) for name, text in renamed.items()}
    files = {
        "main.py": b"",
        "program.mpy": board_files.compiled("program", loader + program),
        board_files.PACK: board_files.packed(codes),
        **more,
    }
    board = board_bench.Board(files)
    board.chip.run(lambda: board.chip.connected)
    try:
        said = board.chip.execute("import program", 60e6)
    except Dead as error:
        said = str(error)
    found = []
    for line in said.splitlines():
        words = line.split()
        if len(words) == 3 and words[1].lstrip("-").isdigit() and words[2].isdigit():
            found.append((words[0].removeprefix("firmware_py."), int(words[1]), int(words[2])))
        else:
            print(line)
    return found


def main() -> None:
    """Print the table of docs/performance.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--key", type=Path)
    parser.add_argument("--model", type=Path)
    args = parser.parse_args()
    more = {}
    if args.key:
        more["key.pub"] = args.key.read_bytes()
    if args.model:
        with tempfile.TemporaryDirectory() as folder:
            more |= board_bench.kept_files(Path(folder), args.model.read_bytes())
    part_of = {module: part for part, modules in _PARTS.items() for module in modules.split()}
    size: defaultdict[str, int] = defaultdict(int)
    us: defaultdict[str, int] = defaultdict(int)
    for name, n, time_us in measured(more):
        part = part_of.get(name, "the board" if name in ("", "firmware_py") or "boards" in name else name)
        size[part] += n
        us[part] += time_us
        print(name, n, time_us)
    table = Table("part", "bytes", "ms")
    for part in size:
        if part != "nothing":
            table.add_row(part, f"{size[part]:,}", f"{us[part] / 1000:.0f}")
    Console().print(table)


if __name__ == "__main__":
    main()
