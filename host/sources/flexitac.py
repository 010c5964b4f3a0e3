"""FlexiTac: a piezoresistive matrix; its frames are AA 55 and a byte a cell, and nothing else.

Source of the wire: flexitac 0.3 (PyPI), `sensor.py`. That package takes the first AA 55 for a frame's start,
also one in a payload, and is silent while no frame comes; so the bytes are cut here (`framing`).
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from palpate.link.schemes import Address
from palpate.sources.array_line import ArrayLine, Image
from palpate.sources.framing import Framing

MARK = b"\xaa\x55"


class FlexiTac(ArrayLine):
    """`flexitac:/dev/ttyUSB0?rows=16&cols=32&pitch=3`."""

    BAUD: ClassVar[int] = 2_000_000

    def __init__(self, address: Address) -> None:
        super().__init__(address)
        rows, columns, *_ = self.shape_
        self._framing = Framing(rows * columns + len(MARK), MARK)

    def feed(self, data: bytes) -> list[Image]:
        """The images that are whole now, 0 to 255."""
        rows, columns, *_ = self.shape_
        frames = self._framing.feed(data)
        return [np.frombuffer(f, np.uint8, offset=2).reshape(rows, columns).astype(float) for f in frames]

    @property
    def slips(self) -> int:
        """Times at which frames stood no longer where they were expected."""
        return self._framing.slips

    def complaint(self) -> str:
        """Why no image has come."""
        rows, columns, *_ = self.shape_
        return self._framing.complaint(f"{rows} x {columns} cells")


def frame(image: Image) -> bytes:
    """An image, 0 to 255, as FlexiTac sends it."""
    return MARK + np.rint(image).clip(0, 255).astype(np.uint8).tobytes()
