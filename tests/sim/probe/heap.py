"""MicroPython's heap on an emulated chip, read out of the chip's memory: the board does not notice.

The garbage collector's table has two bits for each block of 16 bytes, 0 where it is free. Where the table and
the blocks lie stands in the interpreter's own variables, five words that fit no others.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware_py import messages, status
from palpate.errors import PalpateError
from tests.sim.probe.board_bench import Board

LEAST_FREE, LEAST_PIECE = 40_000, 4_000
_RAM = 0x20000000
_BLOCK = 16
_BLOCKS_A_BYTE = 4


@dataclass(frozen=True)
class Heap:
    """What is free of the heap, garbage that was not cleared away yet not counted.

    Attributes: size_bytes, free_bytes, largest_bytes (the largest piece of it).
    """

    size_bytes: int
    free_bytes: int
    largest_bytes: int


def _table(ram: bytes) -> tuple[int, int]:
    """Where the table begins in the memory, and its length in bytes."""
    words = struct.unpack(f"<{len(ram) // 4}I", ram[: len(ram) & ~3])
    end = _RAM + len(ram)
    for at in range(len(words) - 4):
        table, size, finalisers, first, last = words[at : at + 5]
        if (
            _RAM <= table < finalisers < first < last <= end
            and table + size <= finalisers
            and last - first == size * _BLOCKS_A_BYTE * _BLOCK
        ):
            return table - _RAM, size
    raise PalpateError("the interpreter has no heap yet")


def heap(chip: Any) -> Heap:
    """The heap of a chip.Chip as it is now. Raises PalpateError before the interpreter runs."""
    ram = bytes(chip.mcu.sram)
    start, size = _table(ram)
    table = np.frombuffer(ram, np.uint8)[start : start + size]
    free = ((table[:, None] >> np.array((0, 2, 4, 6), np.uint8)) & 3).reshape(-1) == 0
    edges = np.flatnonzero(np.diff(np.r_[0, free.astype(np.int8), 0]))
    pieces = (edges[1::2] - edges[::2]) * _BLOCK
    return Heap(len(free) * _BLOCK, int(pieces.sum()), int(pieces.max(initial=0)))


def leaves_room_while_it_streams(board: Board) -> None:
    """So much is free while a board's stream runs, in pieces that are large enough."""
    content = messages.CONTENT_FRAMES | messages.CONTENT_STROKES
    assert board.ask("stream_start", (content, 1, 0, 60_000)).code == status.OK
    before = len(board.named("frame"))
    board.until(lambda: len(board.named("frame")) > before, 2e6)
    found = heap(board.chip)
    assert board.ask("stream_stop").code == status.OK
    print(f"{found.free_bytes} bytes free, the largest piece {found.largest_bytes}", flush=True)
    assert found.free_bytes > LEAST_FREE
    assert found.largest_bytes > LEAST_PIECE
