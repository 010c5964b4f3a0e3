"""Where the reference board's memory goes: on the emulated RP2040.

    PALPATE_RP2_UF2=... python -m tests.benchmarks.bench_board

The modules are those that `palpate board` makes, and MicroPython itself says what each took. A minute.
"""

from __future__ import annotations

import ast

from palpate.sim.probe.rp2040.board_files import FIRMWARE, PACK, board_files, modules
from tests.sim.probe.board_bench import at_the_prompt

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


def main() -> None:
    """Print the table of docs/performance.md."""
    found = memory()
    print("| module | bytes of the heap |\n|---|--:|")
    for name, taken in sorted(found.items(), key=lambda row: -row[1]):
        print(f"| {name} | {taken:,} |")
    print(f"| all {len(found)} | {sum(found.values()):,} |")


if __name__ == "__main__":
    main()
