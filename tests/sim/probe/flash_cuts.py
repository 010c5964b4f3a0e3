"""Power cuts while the flash chip erases or programs: what it holds then, and what a probe makes of it."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator

import numpy as np
from littlefs import LittleFS, LittleFSError, UserContext

from firmware_py import features, slots, status
from palpate.sim.probe.rp2040 import flash

PAGE = 256


@dataclasses.dataclass(frozen=True)
class Change:
    """One command to the flash chip: where, and the bytes to program; None: erase so many."""

    at: int
    data: bytes | None
    size: int


def apply(chip: bytearray, change: Change) -> None:
    """The command, carried out."""
    end = change.at + change.size
    old = np.frombuffer(chip[change.at : end], np.uint8)
    new = np.uint8(255) if change.data is None else np.frombuffer(change.data, np.uint8)
    chip[change.at : end] = (old | new if change.data is None else old & new).tobytes()


def of_command(command: bytes) -> Change:
    """What a command to the flash chip (code, three bytes of address, data) changes in the file system."""
    at = int.from_bytes(command[1:4], "big") - flash.START
    assert 0 <= at < flash.BYTES, "nothing else is ever written"
    if command[0] == flash.PAGE_PROGRAM:
        return Change(at, command[4:], len(command) - 4)
    return Change(at, None, flash.BLOCK if command[0] == flash.SECTOR_ERASE else 16 * flash.BLOCK)


def cut_short(chip: bytes, change: Change, random: np.random.Generator) -> bytes:
    """The chip after the power went in the middle: some bits have changed, others have not.

    Half of the erasures leave bits that neither were there nor are those of an empty chip: it programs them
    all to 0 before it erases them.
    """
    whole = bytearray(chip)
    apply(whole, change)
    old, new = (np.frombuffer(b, np.uint8)[change.at : change.at + change.size] for b in (chip, whole))
    done = random.random((change.size, 8)) < random.random()
    changed = np.packbits(done, axis=1)[:, 0]
    if change.data is not None:
        # a page's bytes are shifted in one after the other, and programmed at once; some chips start early
        changed = np.where(np.arange(change.size) < random.integers(change.size), 255, changed)
    left = old ^ (old ^ new) & changed
    if change.data is None and random.random() < 0.5:
        left = np.packbits(random.random((change.size, 8)) < random.random(), axis=1)[:, 0]
    whole[change.at : change.at + change.size] = left.tobytes()
    return bytes(whole)


class Recorded(UserContext):
    """A block device in memory that keeps what it was told to change."""

    def __init__(self, blocks: bytes) -> None:
        super().__init__(len(blocks))
        self.buffer = bytearray(blocks)
        self.changes: list[Change] = []

    def read(self, cfg, block, off, size) -> bytearray:
        """littlefs reads."""
        at = block * flash.BLOCK + off
        return self.buffer[at : at + size]

    def prog(self, cfg, block, off, data) -> int:
        """littlefs programs."""
        at = block * flash.BLOCK + off
        for k in range(0, len(data), PAGE):
            piece = bytes(data[k : k + PAGE])
            self.changes.append(Change(at + k, piece, len(piece)))
            apply(self.buffer, self.changes[-1])
        return 0

    def erase(self, cfg, block) -> int:
        """littlefs erases."""
        self.changes.append(Change(block * flash.BLOCK, None, flash.BLOCK))
        apply(self.buffer, self.changes[-1])
        return 0


class LittleStore:
    """firmware_py.store.FileStore on a littlefs as MicroPython's port mounts it."""

    def __init__(self, blocks: bytes) -> None:
        self.device = Recorded(blocks)
        self._system = LittleFS(
            context=self.device,
            block_size=flash.BLOCK,
            block_count=flash.BLOCKS,
            read_size=32,
            prog_size=PAGE,
            lookahead_size=32,
            mount=False,
        )
        self._system.mount()  # MicroPython formats what it cannot mount: that must never be

    def size(self, name: str) -> int:
        """See FileStore."""
        try:
            return int(self._system.stat(name).size)
        except LittleFSError:
            return -1

    def read(self, name: str, offset: int, n: int) -> bytes:
        """See FileStore."""
        try:
            with self._system.open(name, "rb") as file:
                file.seek(offset)
                return bytes(file.read(n))
        except (LittleFSError, FileNotFoundError):
            return b""

    def create(self, name: str, data: bytes = b"") -> int:
        """See FileStore."""
        return self._put(name, "wb", data)

    def append(self, name: str, data: bytes) -> int:
        """See FileStore."""
        return self._put(name, "ab", data)

    def _put(self, name: str, mode: str, data: bytes) -> int:
        with self._system.open(name, mode) as file:
            file.write(bytes(data))
        return status.OK

    def remove(self, name: str) -> None:
        """See FileStore."""
        with contextlib.suppress(LittleFSError, FileNotFoundError):
            self._system.remove(name)

    def sync(self) -> None:
        """A file that was closed is written."""


def probe_on(blocks: bytes, key: bytes) -> tuple[slots.Slots, int]:
    """The slots of a probe that starts on these blocks, and what its start found."""
    probe = slots.Slots(LittleStore(blocks), key, features.FEATURES_VERSION, features.COUNT)
    code = probe.boot()
    probe.settle()
    return probe, code


def states(before: bytes, changes: list[Change], chosen: set[int]) -> Iterator[tuple[int, bytes]]:
    """The chip's bytes before each of the chosen changes."""
    chip = bytearray(before)
    for k, change in enumerate(changes):
        if k in chosen:
            yield k, bytes(chip)
        apply(chip, change)
