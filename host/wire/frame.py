"""One tactile image as the probe sent it, with its position; and the base of all events.

Units: um and mm, kPa, microseconds of the probe's own clock (unwrapped).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from firmware_py import geometry
from palpate.wire.scale import NOMINAL, CellScale

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(slots=True)
class Event:
    """Anything the probe sends unsolicited; `host_ns` is when it reached the host (Unix time, ns)."""

    host_ns: int


@dataclass(slots=True)
class Frame(Event):
    """One tactile image with the probe's place.

    Parameters
    ----------
    seq : int
        Number of the frame, modulo 2^30.
    time_us : int
        The probe's clock at the scan, us, unwrapped.
    position_um, displacement_um : int
        Place along the stroke and indentation, um.
    packed : bytes
        Counts of 12 bit, two in three bytes, row by row along the stroke.
    lost_before : int
        Frames missing just before this one.
    scale : CellScale
        Turns counts into pressures: the probe's calibration where it is known, else the nominal one.
    more : tuple of int
        What the probe tells besides, by `firmware_py.tables.FRAME_MORE`.
    """

    seq: int
    time_us: int
    position_um: int
    displacement_um: int
    packed: bytes
    lost_before: int = 0
    scale: CellScale = field(default=NOMINAL, repr=False, compare=False)
    more: tuple[int, ...] = ()

    @property
    def counts(self) -> NDArray[np.uint16]:
        """The ADC's counts, uint16 of shape (rows along, columns across)."""
        from palpate.wire.packing import unpack  # with numpy, which few commands need

        return unpack(self.packed).reshape(geometry.ROWS, geometry.COLUMNS)

    @property
    def pressure_kPa(self) -> NDArray[np.float32]:
        """Pressures by the calibration stored on the probe (`scale`), float32 (rows, columns), read-only.

        Dead cells are the mean of their neighbours. `scale.calibrated` is False where the probe has told no
        calibration: then the pressures are the nominal sensor's.
        """
        return self.scale.kPa_of(self.packed)

    @property
    def position_mm(self) -> float:
        """Place of the probe's middle, mm."""
        return self.position_um * 1e-3

    @property
    def displacement_mm(self) -> float:
        """The probe's displacement, mm."""
        return self.displacement_um * 1e-3
