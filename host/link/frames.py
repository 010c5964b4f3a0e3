"""One tactile image as the probe sent it, with its place; and what everything that is sent has in common.

Units: um and mm, kPa, microseconds of the probe's own clock (unwrapped).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from firmware_py import messages
from host.link.scale import NOMINAL, CellScale

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(slots=True)
class Event:
    """Anything the probe sends unasked; `host_ns` is when it reached the host (Unix time, ns)."""

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
        416 counts of 12 bit, two in three bytes; row 0..15 along the stroke, then 26 columns across it.
    lost_before : int
        Frames missing just before this one.
    scale : CellScale
        What turns counts into pressures: the probe's calibration where it has told it, else the nominal.
    """

    seq: int
    time_us: int
    position_um: int
    displacement_um: int
    packed: bytes
    lost_before: int = 0
    scale: CellScale = field(default=NOMINAL, repr=False, compare=False)

    @property
    def counts(self) -> NDArray[np.uint16]:
        """The ADC's counts, uint16 of shape (16 along, 26 across)."""
        return unpack_counts(self.packed)

    @property
    def pressure_kPa(self) -> NDArray[np.float32]:
        """Pressures by the calibration stored on the probe (`scale`), float32 of shape (16, 26), kPa.

        Dead cells are the mean of their neighbours. `scale.calibrated` is False where the probe has told no
        calibration: then the pressures are the nominal sensor's.
        """
        return self.scale.kPa(self.counts)

    @property
    def position_mm(self) -> float:
        return self.position_um * 1e-3

    @property
    def displacement_mm(self) -> float:
        return self.displacement_um * 1e-3


def unpack_counts(packed: bytes) -> NDArray[np.uint16]:
    """416 counts of 12 bit out of 624 bytes, uint16 of shape (16, 26) (docs/protocol.md, "Frame")."""
    import numpy as np

    triples = np.frombuffer(packed, np.uint8).reshape(-1, 3).astype(np.uint16)
    counts = np.empty((len(triples), 2), np.uint16)
    counts[:, 0] = triples[:, 0] | (triples[:, 1] & 15) << 8
    counts[:, 1] = triples[:, 1] >> 4 | triples[:, 2] << 4
    return counts.reshape(messages.ROWS, messages.COLUMNS)
