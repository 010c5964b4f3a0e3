"""What a source is: it knows its array's shape and turns its bytes into images.

A source of one's own is a class of this kind under the entry point `palpate.sources`
(docs/howto/your-own-array.md). Imports nothing of the firmware, which must not be loaded before the shape is
known.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.errors import PortError, UsageError
from palpate.link.schemes import Address

if TYPE_CHECKING:
    from palpate.link.transport import Transport

Image = NDArray[np.float64]
COMMON = ("full", "baud", "name", "keep")
"""Options that every source takes: kPa at full scale, baud rate, and what the calibration is kept under."""


class Shape(NamedTuple):
    """An array: rows along a stroke, columns across, pitch in mm, what stands for full scale in kPa."""

    rows: int
    columns: int
    pitch_mm: float
    full_kPa: float = 25.0


class ArrayLine(ABC):
    """One array at the end of a line; `feed` is all that a source must have.

    Parameters
    ----------
    address : Address
        What `--port` said.
    """

    BAUD: ClassVar[int] = 115_200
    OPTIONS: ClassVar[tuple[str, ...]] = ("rows", "cols", "pitch")
    """Options that it takes besides `COMMON`."""
    FULL_RAW: ClassVar[float] = 255.0
    """What it reads at full scale, above air; it is shown so until it is calibrated."""
    LACKS: ClassVar[str] = "clock, numbers, check sums, place or depth"
    """What its frames do not bring, in words."""

    def __init__(self, address: Address) -> None:
        self.address = address
        unknown = set(address.options) - {*COMMON, *self.OPTIONS}
        if unknown:
            raise UsageError(
                f"{address.scheme} takes no {min(unknown)}=; it takes {', '.join((*self.OPTIONS, *COMMON))}"
            )
        self.shape_ = self.shape(address.options)

    @classmethod
    def shape(cls, options: dict[str, str]) -> Shape:
        """The array, by the options of its address.

        Raises
        ------
        UsageError
            One is missing or no number.
        """
        rows, columns, pitch_mm = (number(options, name) for name in ("rows", "cols", "pitch"))
        if rows % 1 or columns % 1:
            raise UsageError("rows= and cols= are whole numbers, as rows=16&cols=32")
        return Shape(int(rows), int(columns), pitch_mm, number(options, "full", 25.0))

    @classmethod
    def open(cls, address: Address) -> Transport:
        """A link to it that speaks as a probe does; see `palpate.link.transport.open_transport`."""
        from palpate.sources.bridge import Bridge

        return Bridge(cls.line(address))

    @classmethod
    def line(cls, address: Address) -> Line:
        """The array itself, its port open."""
        from palpate.link.transport import open_transport

        source = cls(address)
        baud = number(address.options, "baud", float(cls.BAUD))
        return Line(source, open_transport(address.where, int(baud)))

    @abstractmethod
    def feed(self, data: bytes) -> list[Image]:
        """The images that are whole now, raw, of shape (rows, columns)."""

    @property
    def slips(self) -> int:
        """Times at which frames stood no longer where they were expected."""
        return 0

    def complaint(self) -> str:
        """Why no image has come, as the end of a sentence."""
        return "no image comes: is this its port, and its baud rate?"


class Line:
    """A source on its open port: `read` gives images as they come."""

    def __init__(self, source: ArrayLine, transport: Transport) -> None:
        self.source, self._transport = source, transport

    def read(self, timeout_s: float) -> list[Image]:
        """What has come within `timeout_s`.

        Raises
        ------
        LinkGone
            The port vanished.
        PortError
            The source failed, or gave an image of another shape.
        """
        data = self._transport.read(timeout_s)
        name = self.source.address.text
        try:
            images = self.source.feed(data) if data else []
        except Exception as error:  # somebody else's code
            what = f"{type(error).__name__}: {error}"
            raise PortError(name, f"{name} cannot be read: its source failed with {what}") from error
        for image in images:
            if image.shape != self.source.shape_[:2] or not np.isfinite(image).all():
                what = f"an image of {image.shape} with {np.isfinite(image).sum()} finite numbers"
                raise PortError(name, f"{name} cannot be read: {what}, not {self.source.shape_[:2]}")
        return images

    def drain(self) -> None:
        """Forget what has been waiting: nobody knows since when."""
        for _ in range(64):
            if not self._transport.read(0.0):
                return

    def close(self) -> None:
        """Give the port back."""
        self._transport.close()


def number(options: dict[str, Any], name: str, unless_told: float | None = None) -> float:
    """A positive number among the options; units that are told must be the usual ones.

    Raises
    ------
    UsageError
        It is missing and there is no value to take instead, or it is none.
    """
    unit = {"pitch": "mm", "full": "kPa"}.get(name, "")
    if name not in options:
        if unless_told is None:
            raise UsageError(f"say {name}= of the array, as rows=16&cols=32&pitch=3mm")
        return unless_told
    try:
        value = float(str(options[name]).removesuffix(unit) if unit else options[name])
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise UsageError(f"{name}={options[name]} is no positive number" + (f" of {unit}" if unit else ""))
    return value
