"""Where the reference board's memory and time go: on the emulated RP2040.

    PALPATE_RP2_UF2=... python -m tests.benchmarks.bench_board [memory | time]

The modules are those that `palpate board` makes, and MicroPython itself says what each took. The times are of
device time, so they are the same on every computer: once in plain loops, once in machine code. Minutes.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import defaultdict
from pathlib import Path

from firmware_py import features, messages, signature
from palpate.link import emulator_model as emulator
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
from tests.firmware_py.strokes import read_strokes
from tests.sim.probe.board_bench import at_the_prompt

SCRIPT = Path(__file__).with_name("board_script.py")
FRAMES = 50
CYCLES_A_US = 125
LIMIT_US = 60e6
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


def main() -> None:
    """Print the tables of docs/performance.md."""
    wanted = sys.argv[1:] or ["memory", "time"]
    if "memory" in wanted:
        print_memory()
    if "time" in wanted:
        print_times()


if __name__ == "__main__":
    main()
