"""What an emulated probe's sensors will read, frame after frame, as the file that its board plays.

Units: um, counts of 12 bits.
"""

import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

import numpy as np

from firmware_py import messages

RECORD_BYTES = 8 + messages.PACKED
ZERO_COUNTS = 82  # what a cell reads without pressure: .5 of 25 kPa


class Frames(Protocol):
    """A stroke as frames: `sim.probe.sensors.FrameStream` is one."""

    packed: np.ndarray  # (n, 624) uint8
    positions_um: np.ndarray  # (n,) int
    displacements_um: np.ndarray  # (n,) int


def pack_counts(counts: np.ndarray) -> np.ndarray:
    """Two counts of 12 bits in three bytes.

    Parameters: counts (..., 2k) integers 0 to 4095. Returns (..., 3k) uint8.
    """
    low, high = counts[..., 0::2].astype(np.uint16), counts[..., 1::2].astype(np.uint16)
    packed = np.stack([low & 255, low >> 8 | (high & 15) << 4, high >> 4], axis=-1)
    return packed.reshape(*counts.shape[:-1], -1).astype(np.uint8)


def unpack_counts(packed: np.ndarray) -> np.ndarray:
    """The counts of `pack_counts`: (..., 3k) uint8 to (..., 2k) uint16."""
    triples = packed.reshape(*packed.shape[:-1], -1, 3).astype(np.uint16)
    first = triples[..., 0] | (triples[..., 1] & 15) << 8
    second = triples[..., 1] >> 4 | triples[..., 2] << 4
    return np.stack([first, second], axis=-1).reshape(*packed.shape[:-1], -1)


def lifted_record(position_um: int = 0) -> bytes:
    """One frame of a probe in the air."""
    counts = np.full(messages.CELLS, ZERO_COUNTS)
    return struct.pack("<ii", position_um, 0) + pack_counts(counts).tobytes()


def records(frames: Frames) -> bytes:
    """A stroke's frames in the source file's form."""
    out = bytearray()
    for packed, position, displacement in zip(
        frames.packed, frames.positions_um, frames.displacements_um, strict=True
    ):
        out += struct.pack("<ii", int(position), int(displacement))
        out += bytes(packed)
    return bytes(out)


def write_source(path: Path, strokes: Iterable[Frames], lifted: int = 3) -> Path:
    """Write strokes one after the other, the probe `lifted` frames in the air before and after each."""
    air = lifted_record() * lifted
    data = air + b"".join(records(stroke) + air for stroke in strokes)
    path.write_bytes(data)
    return path
