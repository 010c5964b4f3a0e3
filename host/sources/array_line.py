"""What a source is: it knows its array's shape and turns its bytes into images.

A source of one's own is a class of this kind under the entry point `palpate.sources`
(docs/howto/your-own-array.md). Imports nothing of the firmware, which must not be loaded before the shape is
known.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.errors import PortError, UsageError
from palpate.link import face
from palpate.link.schemes import Address, number

if TYPE_CHECKING:
    from palpate.link.transport import Transport
    from palpate.sources.encoder import PlaceSource

Image = NDArray[np.float64]
COMMON = ("full", "baud", "name", "keep", "position", "position_baud", *face.OPTIONS)
"""Options that every source takes: kPa at full scale, baud rate, where the calibration is kept, a second port
that gives places, the face."""


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
        face.face_of(address.options)  # what is wrong with it is said at once

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
    def line(cls, address: Address) -> OpenArray:
        """The array itself, its port open."""
        from palpate.link.transport import open_transport

        source, told = cls(address), address.options
        transport = open_transport(address.where, int(number(told, "baud", float(cls.BAUD))))
        if "position" not in told:
            return OpenArray(source, transport)
        from palpate.sources.encoder import PlaceSource

        try:
            second = open_transport(told["position"], int(number(told, "position_baud", 115_200.0)))
        except BaseException:
            transport.close()
            raise
        return OpenArray(source, transport, PlaceSource(told["position"], second))

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


class OpenArray:
    """A source on its open port: `read` gives images as they come; beside it what gives their places."""

    def __init__(self, source: ArrayLine, transport: Transport, encoder: PlaceSource | None = None) -> None:
        self.source, self.encoder, self._transport = source, encoder, transport

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
        """Give the ports back."""
        self._transport.close()
        if self.encoder is not None:
            self.encoder.close()
