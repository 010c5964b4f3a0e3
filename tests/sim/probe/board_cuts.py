"""Cuts of the emulated board's power while a model is flashed, and what the board makes of each.

    python -m tests.sim.probe.board_cuts --cuts 200 --write

The board is flashed once, and every command to its flash chip kept. A cut comes between two of them, or
leaves one half done. From what the chip then holds the board starts: bootrom, MicroPython, littlefs, firmware
and signature. A start is determined by the bytes that it reads: where two chips agree in all that littlefs
can reach, it is emulated once for both.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import json
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from firmware_py import status
from palpate import models
from palpate.model_export.signing import keys
from palpate.sim.probe.rp2040 import flash
from tests.sim.probe.board_bench import Board, bundled, kept_files
from tests.sim.probe.flash_cuts import Change, Recorded, cut_short, of_command, states

RESULTS = Path(__file__).parents[3] / "docs" / "reliability" / "board.json"
CUTS = 200
OVERS = {"a live model": models.ANYWHERE, "an empty board": None}
TOLD = (status.OK, status.NO_MODEL, status.TRIAL_HUNG, status.REPAIRED)
"""What the start may find: nothing, no model yet, one that was being tried, one copy of a record torn."""
_XIP, _XIP_END = 0x10000000 + flash.START, 0x10000000 + flash.START + flash.BYTES
_READS = ("read_uint8", "read_uint16", "read_uint32")


@dataclass(frozen=True)
class Flashed:
    """The file system's blocks before, what flashing changed in them, and the two models (old: or None)."""

    before: bytes
    changes: list[Change]
    old: bytes | None
    new: bytes


@dataclass(frozen=True)
class Start:
    """What a board said: status of its boot message, status and id of its model."""

    boot: int
    model: int
    model_id: bytes

    def found(self, flashed: Flashed) -> str:
        """Which model is live: old, new, none; or lost, where it is none that should be."""
        if self.boot in TOLD and self.model == status.OK:
            if self.model_id == flashed.new[40:48]:
                return "new"
            if flashed.old and self.model_id == flashed.old[40:48]:
                return "old"
        if self.boot in TOLD and flashed.old is None and self.model == status.NO_MODEL:
            return "none"
        return "lost"


@dataclass(frozen=True)
class Cut:
    """A cut before command k, or in the midst of it (torn), and what the chip holds after it."""

    k: int
    torn: bool
    blocks: bytes


def record(folder: Path, key_dir: Path, over: str) -> Flashed:
    """Flash a bundled model onto a board over this (of OVERS)."""
    old = OVERS[over] and bundled(str(OVERS[over]), key_dir)
    new = bundled(models.FIELD, key_dir)
    files = {"key.pub": (key_dir / "public.key").read_bytes(), **kept_files(folder, old or None)}
    board = Board(files).until_up()
    before = board.chip.files()
    changes: list[Change] = []
    board.chip.before_flash = lambda command: changes.append(of_command(command))
    board.flash(new)
    for _, after in states(before, [*changes, changes[-1]], {len(changes)}):
        assert after == board.chip.files(), "what was recorded is all that happened"
    return Flashed(before, changes, old or None, new)


def cuts(flashed: Flashed, n: int) -> list[Cut]:
    """So many at random commands; every second one leaves its command half done."""
    random = np.random.default_rng(13)
    chosen = Counter(random.integers(len(flashed.changes), size=n).tolist())
    made: list[Cut] = []
    for k, chip in states(flashed.before, flashed.changes, set(chosen)):
        for _ in range(chosen[k]):
            torn = len(made) % 2 == 0
            made.append(Cut(k, torn, cut_short(chip, flashed.changes[k], random) if torn else chip))
    return made


class _Read(Recorded):
    """A block device in memory that keeps which of its blocks were read."""

    def __init__(self, blocks: bytes) -> None:
        super().__init__(blocks)
        self.blocks: set[int] = set()

    def read(self, cfg: Any, block: int, off: int, size: int) -> bytearray:
        """littlefs reads."""
        self.blocks.add(block)
        return super().read(cfg, block, off, size)


def within_reach(blocks: bytes) -> dict[int, bytes]:
    """The blocks that littlefs reads where it is mounted and every file is read; no start can read others."""
    device = _Read(blocks)
    files = flash.read(blocks, device)
    assert files
    return {n: blocks[n * flash.BLOCK : (n + 1) * flash.BLOCK] for n in sorted(device.blocks)}


def alike(some: list[Cut]) -> list[list[Cut]]:
    """The cuts whose starts read the very bytes, together; the largest groups first."""
    groups: dict[bytes, list[Cut]] = {}
    for cut in some:
        digest = hashlib.sha256()
        for n, block in within_reach(cut.blocks).items():
            digest.update(n.to_bytes(4, "little") + block)
        groups.setdefault(digest.digest(), []).append(cut)
    return sorted(groups.values(), key=len, reverse=True)


def start(blocks: bytes, watch: Callable[[Board], None] = lambda _: None) -> Start:
    """Power comes; what the board says. `watch` sees it first."""
    board = Board(blocks=blocks)
    watch(board)
    board.until_up(20e6)
    (boot,) = board.named("boot")
    identity = board.ask("identify", (7,)).fields
    return Start(boot["status"], identity["model_status"], identity["model_id"])


def read_by(blocks: bytes) -> set[int]:
    """The blocks that a start has read, each access to memory looked at: three times as slow."""
    read: set[int] = set()

    def noted(access: Callable[[int], int]) -> Callable[[int], int]:
        def looked(address: int) -> int:
            if _XIP <= address < _XIP_END:
                read.add((address - _XIP) // flash.BLOCK)
            return access(address)

        return looked

    def watch(board: Board) -> None:
        for name in _READS:
            setattr(board.chip.mcu, name, noted(getattr(board.chip.mcu, name)))

    start(blocks, watch)
    return read


def campaign(flashed: Flashed, n: int, over: str) -> dict[str, int]:
    """Counts of n cuts, printed as they come: starts emulated, kinds of cuts, and what was live."""
    counted: Counter[str] = Counter(cuts=0, lost=0)
    groups = alike(cuts(flashed, n))
    print(f"{n} cuts over {over}, in {len(flashed.changes)} commands: {len(groups)} starts", flush=True)
    for group in groups:
        said = start(group[0].blocks)
        found = said.found(flashed)
        counted["starts emulated"] += 1
        counted["cuts"] += len(group)
        counted[found] += len(group)
        counted["told of it"] += len(group) * (said.boot in (status.TRIAL_HUNG, status.REPAIRED))
        for cut in group:
            kind = "erasing" if flashed.changes[cut.k].data is None else "programming"
            counted[f"while {kind}" if cut.torn else "between two commands"] += 1
        if found == "lost":
            print(f"lost: {[(cut.k, cut.torn) for cut in group]}: {said}", flush=True)
        print(f"over {over}: {dict(counted)}", flush=True)
    return dict(counted)


def write(results: dict[str, dict[str, int]], command: str, path: Path = RESULTS) -> None:
    """The figures as docs/reliability.md has them."""
    total = {k: sum(one[k] for one in results.values()) for k in ("cuts", "lost", "starts emulated")}
    date = datetime.datetime.now(datetime.UTC).date().isoformat()
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"command": command, "date": date, **total, "over": results}, indent=1)
    path.write_text(text + "\n", encoding="utf-8")


def main() -> None:
    """Run the campaign from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cuts", type=int, default=CUTS, help="in all")
    parser.add_argument("--write", action="store_true", help=f"the counts into {RESULTS.name}")
    given = parser.parse_args()
    results = {}
    with tempfile.TemporaryDirectory() as home:
        keys.generate(Path(home) / "key")
        for n, over in enumerate(OVERS):
            folder = Path(home) / str(n)
            folder.mkdir()
            flashed = record(folder, Path(home) / "key", over)
            results[over] = campaign(flashed, given.cuts // len(OVERS), over)
    if given.write:
        write(results, f"python -m tests.sim.probe.board_cuts --cuts {given.cuts} --write")


if __name__ == "__main__":
    main()
