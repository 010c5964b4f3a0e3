"""Cuts of the emulated board's power while a model is flashed, and what the board makes of each.

    python -m tests.sim.probe.board_cuts --cuts 200 --write

The board is flashed once, and every command to its flash chip kept. A cut comes between two of them, or
leaves one half done. From what the chip then holds the board starts: bootrom, MicroPython, littlefs, firmware
and signature. A start is determined by the bytes that it reads: where two chips agree in all of these, it is
emulated once for both.
"""

from __future__ import annotations

import argparse
import datetime
import json
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from firmware_py import status
from palpate import models
from palpate.model_export.signing import keys
from palpate.sim.probe.rp2040 import flash
from tests.sim.probe.board_bench import Board, bundled, kept_files
from tests.sim.probe.flash_cuts import Change, cut_short, of_command, states

RESULTS = Path(__file__).parents[3] / "docs" / "reliability" / "board.json"
CUTS = 200
OVERS = {"a live model": models.ANYWHERE, "an empty board": None}
TOLD = (status.OK, status.NO_MODEL, status.TRIAL_HUNG, status.REPAIRED)
"""What the start may find: nothing, no model yet, one that was being tried, one copy of a record torn."""
_LINE = 32
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
    board = Board({"key.pub": (key_dir / "public.key").read_bytes(), **kept_files(folder, old or None)})
    board.until(lambda: bool(board.named("boot")), 10e6)
    before = board.chip.files()
    changes: list[Change] = []
    board.chip.before_flash = lambda command: changes.append(of_command(command))
    board.flash(new)
    for _, after in states(before, [*changes, changes[-1]], {len(changes)}):
        assert after == board.chip.files(), "what was recorded is all that happened"
    return Flashed(before, changes, old or None, new)


def cuts(flashed: Flashed, n: int, seed: int = 13) -> list[Cut]:
    """So many at random commands; every second one leaves its command half done."""
    random = np.random.default_rng(seed)
    chosen = Counter(random.integers(len(flashed.changes), size=n).tolist())
    made: list[Cut] = []
    for k, chip in states(flashed.before, flashed.changes, set(chosen)):
        for _ in range(chosen[k]):
            torn = len(made) % 2 == 0
            made.append(Cut(k, torn, cut_short(chip, flashed.changes[k], random) if torn else chip))
    return made


def _noted(lines: set[int], read: Callable[[int], int]) -> Callable[[int], int]:
    """The same access to memory, which notes where in the file system it was."""

    def looked(address: int) -> int:
        if _XIP <= address < _XIP_END:
            lines.add((address - _XIP) // _LINE)
        return read(address)

    return looked


def _watch(board: Board) -> set[int]:
    """The lines of the file system that the board will have read, or programmed, from here on."""
    lines: set[int] = set()
    mcu: Any = board.chip.mcu
    for name in _READS:
        setattr(mcu, name, _noted(lines, getattr(mcu, name)))

    def programmed(command: bytes) -> None:
        change = of_command(command)
        if change.data is not None:
            lines.update(range(change.at // _LINE, -(-(change.at + change.size) // _LINE)))

    board.chip.before_flash = programmed
    return lines


@dataclass
class Starts:
    """Starts of the board from what its chip holds; those that read alike are emulated once."""

    emulated: int = 0
    _known: list[tuple[np.ndarray, np.ndarray, Start]] = field(default_factory=list)

    def known(self, blocks: bytes) -> Start | None:
        """What the board says, where a start that read all of this has been emulated."""
        lines = np.frombuffer(blocks, np.uint8).reshape(-1, _LINE)
        for places, read, start in self._known:
            if np.array_equal(lines[places], read):
                return start
        return None

    def start(self, blocks: bytes) -> Start:
        """Emulate one."""
        board = Board(blocks=blocks)
        read = _watch(board)
        board.until(lambda: bool(board.named("boot")), 20e6)
        (boot,) = board.named("boot")
        identity = board.ask("identify", (7,)).fields
        start = Start(boot["status"], identity["model_status"], identity["model_id"])
        places = np.array(sorted(read))
        self._known.append((places, np.frombuffer(blocks, np.uint8).reshape(-1, _LINE)[places], start))
        self.emulated += 1
        return start


def tried(flashed: Flashed, some: list[Cut], starts: Starts) -> Iterator[tuple[Cut, Start]]:
    """Each cut and what the board says after it; those that need no start of their own come first."""
    left = list(np.random.default_rng(1).permutation(np.arange(len(some))))
    while left:
        said = starts.start(some[left[0]].blocks)
        yield some[left.pop(0)], said
        for n in list(left):
            again = starts.known(some[n].blocks)
            if again is not None:
                left.remove(n)
                yield some[n], again


def campaign(flashed: Flashed, n: int, over: str) -> dict[str, int]:
    """Counts of n cuts, printed as they come: starts emulated, kinds of cuts, and what was live."""
    counted: Counter[str] = Counter(cuts=0, lost=0)
    starts = Starts()
    for cut, said in tried(flashed, cuts(flashed, n), starts):
        counted["cuts"] += 1
        found = said.found(flashed)
        counted[found] += 1
        kind = "erasing" if flashed.changes[cut.k].data is None else "programming"
        counted[f"while {kind}" if cut.torn else "between two commands"] += 1
        counted["told of it"] += said.boot in (status.TRIAL_HUNG, status.REPAIRED)
        counted["starts emulated"] = starts.emulated
        if found == "lost":
            print(f"lost: command {cut.k}, torn {cut.torn}: {said}", flush=True)
        print(f"over {over}, {len(flashed.changes)} commands: {dict(counted)}", flush=True)
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
