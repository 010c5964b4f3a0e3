r"""ReSkin and AnySkin: five magnetometers under a magnetic skin; a frame is four floats each and \r\n.

Of each magnetometer: temperature, then the field's x, y and z in uT. Shown is how far the field has
moved from what it was in the air, which grows with pressure; each cell shows its nearest magnetometer.

Source of the wire: reskin_sensor 2.0 (PyPI), `sensor.py`, whose reader keeps a core busy and waits for ever
on a silent port; so the bytes are cut here. Source of where the magnetometers lie: the makers' viewers.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from palpate.link.schemes import Address
from palpate.sources.array_line import ArrayLine, Image, Shape, number
from palpate.sources.framing import Framing

MARK = b"\r\n"
SENSORS = 5
APART_MM = 7.0
"""From the middle one to the others."""
CELLS, PITCH_MM = 8, 2.5


class ReSkin(ArrayLine):
    """`reskin:/dev/ttyACM0`; `full=` is kPa at 2000 uT, until it is calibrated."""

    OPTIONS: ClassVar[tuple[str, ...]] = ()
    FULL_RAW: ClassVar[float] = 2000.0
    ORDER: ClassVar[str] = "middle, up, right, down, left"
    LACKS: ClassVar[str] = (
        "clock, numbers, check sums, place or depth, and five sensors are stretched to 8 x 8"
    )

    def __init__(self, address: Address) -> None:
        super().__init__(address)
        self._framing = Framing(16 * SENSORS + len(MARK), MARK, at=16 * SENSORS)
        self._nearest = nearest(self.ORDER)
        self._air: NDArray[np.float64] | None = None

    @classmethod
    def shape(cls, options: dict[str, str]) -> Shape:
        """8 x 8 cells at 2.5 mm."""
        return Shape(CELLS, CELLS, PITCH_MM, number(options, "full", 25.0))

    def feed(self, data: bytes) -> list[Image]:
        """How far the field has moved since the first frame, uT."""
        images = []
        for whole in self._framing.feed(data):
            field = np.frombuffer(whole, "<f4", 4 * SENSORS).reshape(SENSORS, 4)[:, 1:].astype(float)
            if not np.isfinite(field).all():
                continue
            self._air = field if self._air is None else self._air
            images.append(np.linalg.norm(field - self._air, axis=1)[self._nearest])
        return images

    @property
    def slips(self) -> int:
        """Times at which frames stood no longer where they were expected."""
        return self._framing.slips

    def complaint(self) -> str:
        """Why no image has come."""
        return self._framing.complaint(f"{SENSORS} magnetometers")


class AnySkin(ReSkin):
    """`anyskin:/dev/ttyACM0`: ReSkin's wire, its magnetometers in another order."""

    ORDER: ClassVar[str] = "middle, left, right, up, down"


def nearest(order: str) -> NDArray[np.intp]:
    """Of each cell (rows, columns), which magnetometer is nearest."""
    away = {"middle": (0, 0), "up": (-1, 0), "down": (1, 0), "left": (0, -1), "right": (0, 1)}
    places = APART_MM * np.array([away[name] for name in order.split(", ")])
    mm = PITCH_MM * (np.arange(CELLS) - (CELLS - 1) / 2)
    cells = np.stack(np.meshgrid(mm, mm, indexing="ij"), axis=-1)
    return np.linalg.norm(cells[:, :, None] - places, axis=-1).argmin(axis=-1)


def frame(field_uT: NDArray[np.float64], temperature_C: float = 25.0) -> bytes:
    """The fields (5, 3) as ReSkin sends them."""
    told = np.column_stack([np.full(SENSORS, temperature_C), field_uT])
    return told.astype("<f4").tobytes() + MARK
