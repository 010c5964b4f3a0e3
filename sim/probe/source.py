"""The frames that an emulated probe's sensors will read, as the file that its board plays.

Units: um, counts of 12 bits.
"""

import struct
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from firmware_py import geometry

FRAMES_PER_S = 37.5
"""The usual rate."""
RECORD_BYTES = 8 + geometry.FRAME_BYTES
LIFTED = 3
LIFTED_AS_BY_HAND = 24
"""Frames in the air between two strokes. The second is .6 s of a real hand: while a board works a stroke out,
half a second, it looks at no frames, and would miss the beginning of the next one."""


class FramedStroke(Protocol):
    """A stroke as frames: `palpate.sim.probe.sensors.FrameStream` is one."""

    @property
    def packed(self) -> Sequence[bytes]:
        """geometry.FRAME_BYTES each."""

    @property
    def positions_um(self) -> np.ndarray:
        """(n,) int."""

    @property
    def displacements_um(self) -> np.ndarray:
        """(n,) int."""


def lifted_record() -> bytes:
    """One frame of a probe in the air."""
    zero = geometry.PEDESTAL_COUNTS
    pair = zero | zero << 12
    return bytes(8) + pair.to_bytes(3, "little") * (geometry.CELLS // 2)


def records(frames: FramedStroke) -> bytes:
    """A stroke's frames in the source file's form."""
    out = bytearray()
    for packed, position, displacement in zip(
        frames.packed, frames.positions_um, frames.displacements_um, strict=True
    ):
        out += struct.pack("<ii", int(position), int(displacement))
        out += bytes(packed)
    return bytes(out)


def write_source(path: Path, strokes: Iterable[FramedStroke], lifted: int = LIFTED) -> Path:
    """Write strokes one after the other, the probe `lifted` frames in the air before and after each."""
    air = lifted_record() * lifted
    data = air + b"".join(records(stroke) + air for stroke in strokes)
    path.write_bytes(data)
    return path
