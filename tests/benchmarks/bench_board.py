"""Where the reference board's memory and time go: on the emulated RP2040.

    PALPATE_RP2_UF2=... python -m tests.benchmarks.bench_board [memory | time | across]

The modules are those that `palpate board` makes, and MicroPython itself says what each took. The times are of
device time, so they are the same on every computer: once in plain loops, once in machine code. Minutes.
`across`: what the width and the place across a ball, which the host works out, would take of the memory
that is left.
"""

from __future__ import annotations

import ast
import re
import sys
import tempfile
from array import array
from collections import defaultdict
from pathlib import Path

from firmware_py import features, messages, outputs, results, signature
from palpate import models
from palpate.answer import across
from palpate.link import emulator_model as emulator
from palpate.model_export.fixed_point import compiler
from palpate.sim.probe.over_lump import strokes_over
from palpate.sim.probe.rp2040.board_files import (
    AT_THE_PROMPT,
    FIRMWARE,
    PACK,
    board_files,
    compiled,
    modules,
    packed,
)
from palpate.sim.probe.rp2040.lean import lean
from palpate.sim.probe.rp2040.main_text import main_text
from palpate.sim.probe.rp2040.names import borrowed
from palpate.sim.probe.sensors import LEVELS, SensorModel, StrokeField
from palpate.wire.cells import COLUMN_MM
from tests.firmware_py.strokes import read_strokes
from tests.sim.probe import board_bench
from tests.sim.probe.board_bench import at_the_prompt
from tests.sim.probe.heap import heap

SCRIPT = Path(__file__).with_name("board_script.py")
FRAMES = 50
CYCLES_A_US = 125
LIMIT_US = 60e6
WANTED = 40_000
"""Bytes of the heap that are to stay free."""
PARTS = {
    "into a frame": "scan: the measured cells into a frame",
    "contact: rows summed": "contact: a frame's rows summed",
    "crc": "CRC-32 of a frame, 648 bytes",
    "cobs": "COBS of a frame",
    "a frame into its bin": "pipeline, a frame: unpacked into its bin",
    "finish": "pipeline, a stroke: all that follows its last frame; of that",
    "finish_take": "- calibrating its bins",
    "finish_move": "- force map (before each fit)",
    "finish_find": "- finding the lump",
    "finish_fit": "- map and Gaussian fit (twice)",
    "finish_choose": "- columns that see the lump",
    "finish_measure": "- profile and features",
    "evaluator": "evaluator, the bundled model",
}

MEMORY = """
exec(open("loader.py").read())
import gc
def taken(name):
    gc.collect()
    before = gc.mem_alloc()
    __import__("firmware_py." + name)
    gc.collect()
    print(name, "|", gc.mem_alloc() - before)
"""


def in_order(sources: dict[str, str]) -> list[str]:
    """Modules, each after those that it imports as it is loaded."""
    found: list[str] = []

    def visit(name: str) -> None:
        if name in found or f"{name}.py" not in sources:
            return
        for node in ast.parse(sources[f"{name}.py"]).body:
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("firmware_py"):
                folder = (node.module or "").removeprefix("firmware_py").replace(".", "/").lstrip("/")
                for alias in node.names:
                    visit(f"{folder}/{alias.name}" if folder else alias.name)
        found.append(name)

    visit("boards/rp2_reference")
    return found


def memory() -> dict[str, int]:
    """Bytes of the heap that each module takes."""
    sources = {name: (FIRMWARE / name).read_text() for name in modules()}
    names = [name.replace("/", ".") for name in in_order(sources)]
    board = at_the_prompt(board_files()[PACK])
    board.chip.execute(MEMORY)
    # modules that only state numbers are not on the board
    script = f"for name in {names!r}:\n try:\n  taken(name)\n except ImportError:\n  pass"
    lines = board.chip.execute(script, 60e6).splitlines()
    return {name.strip(): int(n) for name, _, n in (line.partition("|") for line in lines)}


def script_pack(script: str) -> bytes:
    """The firmware's modules, in which everything that the script mentions keeps its name."""
    main = main_text(False, messages.TYPE["log"]) + "\nfrom firmware_py import model_image\n"
    sources = lean({name: (FIRMWARE / name).read_text() for name in modules()}, main + script)
    sources = borrowed(sources, {*AT_THE_PROMPT, *re.findall(r"\w+", main + script)})
    return packed({name: compiled(name, text) for name, text in sources.items()})


def recorded() -> tuple[bytes, bytes]:
    """A stroke's frames as the script reads them, and the calibration."""
    model = SensorModel(StrokeField(*read_strokes()[0]), LEVELS["typical"], 1)
    stream = model.stroke(FRAMES)
    out = bytearray()
    for counts, *lengths in zip(stream.packed, stream.positions_um, stream.displacements_um, strict=True):
        for length in lengths:
            out += (int(length) + 0x800000).to_bytes(4, "little")
        out += bytes(counts)
    return bytes(out), model.calibration().to_bytes()


def times_us(fast: bool) -> dict[str, float]:
    """Device time of each part."""
    image = emulator.image()
    sizes = (len(image) - signature.size(emulator.public_key()), features.FEATURES_VERSION, features.COUNT)
    script = SCRIPT.read_text().replace("FAST = False", f"FAST = {fast}").replace("(0, 0, 0)", str(sizes))
    frames, calibration = recorded()
    files = {
        "frames": frames,
        "calibration": calibration,
        "model": image,
        "script.mpy": compiled("script", script),
    }
    board = at_the_prompt(script_pack(script), files=files)
    spent: dict[str, float] = defaultdict(float)
    said = board.chip.execute("exec(open('loader.py').read())\nimport script", LIMIT_US)
    for part, times, us in (line.split(" | ") for line in said.splitlines()):
        spent[part] += int(us) / int(times)
    return spent


def print_times() -> None:
    """Print the table of device times."""
    plain, fast = times_us(False), times_us(True)
    print("| part | plain loops, ms | machine code, ms | cycles |\n|---|--:|--:|--:|")
    for part, name in PARTS.items():
        cycles = CYCLES_A_US * fast[part]
        slow = f"{plain[part] / 1000:,.2f}" if part in plain else ""
        print(f"| {name} | {slow} | {fast[part] / 1000:,.2f} | {cycles:,.0f} |")


def print_memory() -> None:
    """Print the table of modules."""
    found = memory()
    print("| module | bytes of the heap |\n|---|--:|")
    for name, taken in sorted(found.items(), key=lambda row: -row[1]):
        print(f"| {name} | {taken:,} |")
    print(f"| all {len(found)} | {sum(found.values()):,} |")


def across_bytes() -> dict[str, int]:
    """Bytes of the heap that the width and the place across would take on the probe, code not counted."""
    spec = models.load("balls")
    assert spec.across is not None and spec.first is not None
    ids = compiler.feature_ids(spec.across.width.features, spec.first)
    stage = compiler.compile_stage(spec.across.width, ids, 0)
    parts = {name: part for name, part in vars(stage).items() if isinstance(part, array | bytes)}
    stage_bytes = sum(len(p) * getattr(p, "itemsize", 1) for name, p in parts.items() if name != "x")
    kept = sum(size for _, size, numbers in results._KEPT if numbers == outputs.VALUES)
    told = 4 * len(outputs.PARTS) * kept
    # half a Gaussian at every place of the grid that a column can be away, 16 bits each; the columns' shares
    # less their mean; four sums
    farthest = across._PLACES_MM.max() + COLUMN_MM.max()
    step = across._PLACES_MM[1] - across._PLACES_MM[0]
    grid = 2 * round(farthest / step + 1) + 4 * len(COLUMN_MM) + 4 * 4
    return {
        "width across": stage_bytes + 4 * len(spec.across.width_spread) + told,
        "place across": grid + told,
    }


def free_bytes() -> int:
    """Of the heap of a board that streams with the model of balls live."""
    _, calibration = strokes_over("d12h07e20f09", "real", 1, 40, 1, press=True)
    with tempfile.TemporaryDirectory() as folder:
        kept = board_bench.kept_files(Path(folder), emulator.image("balls"), calibration)
    board = board_bench.Board({"key.pub": emulator.public_key(), **kept})
    board.hand.begin = board.hand.end = lambda *_: None  # type: ignore[method-assign]
    board.until(lambda: len(board.logs()) >= 3, 10e6)
    assert board.ask("identify", (7,)).fields["model_status"] == 0
    board.ask("stream_start", (messages.CONTENT_FRAMES | messages.CONTENT_STROKES, 1, 0, 60_000))
    board.until(lambda: bool(board.named("frame")), 2e6)
    return heap(board.chip).free_bytes


def print_across() -> None:
    """Print the bytes of it."""
    free = free_bytes() - WANTED
    print(f"free while it streams with `balls` live, above {WANTED:,}: {free:,} bytes")
    like = memory()["search"]  # the module that looks for a bump along the stroke, and is shorter than both
    for name, taken in across_bytes().items():
        missing = f"{taken - free:,} missing; {taken + like - free:,} with code as search.py's"
        print(f"{name}: {taken:,} bytes, {missing}")


def main() -> None:
    """Print the tables of docs/performance.md."""
    wanted = sys.argv[1:] or ["memory", "time", "across"]
    if "memory" in wanted:
        print_memory()
    if "time" in wanted:
        print_times()
    if "across" in wanted:
        print_across()


if __name__ == "__main__":
    main()
