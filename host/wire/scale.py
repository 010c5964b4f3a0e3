"""Counts to pressure as the probe's own calibration says: every cell's zero and gain, and its dead cells.

Units: kPa, Pa; a calibration is what `firmware_py.calib` keeps on the probe.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

from firmware_py import calib, geometry, messages, status

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class CellScale:
    """Offset, gain and dead cells of one probe; the nominal sensor until `load`.

    Attributes
    ----------
    calibrated : bool
        True where a probe has told its calibration; False for the nominal sensor (`firmware_py.geometry`).
    """

    def __init__(self) -> None:
        self.calibrated = False
        self._calibration = calib.Calibration()
        self._newest: tuple[bytes | None, Any] = None, None

    def load(self, blob: bytes) -> bool:
        """Load a calibration as the probe stores it; False (and nothing changed) if it is not one."""
        read = calib.Calibration()
        if read.load(blob) != status.OK:
            return False
        self._calibration, self.calibrated = read, True
        self._newest = None, None
        for name in ("_offset", "_kPa_per_eighth", "_fill"):
            self.__dict__.pop(name, None)
        return True

    def kPa_of(self, packed: bytes) -> NDArray[np.float32]:
        """Pressure of a packed image, read-only; page, stroke and recording ask for the newest in turn."""
        last, cells = self._newest
        if last is not packed:
            from palpate.wire.packing import unpack  # with numpy, which few commands need

            cells = self.kPa(unpack(packed))
            cells.setflags(write=False)
            self._newest = packed, cells
        return cells

    def kPa(self, counts: NDArray[np.uint16]) -> NDArray[np.float32]:
        """Pressure of a tactile image: counts (rows, columns) to kPa; dead cells from their neighbours."""
        import numpy as np

        eighths = counts.reshape(-1).astype(np.float32) * np.float32(8.0)
        cells = (eighths - self._offset) * self._kPa_per_eighth
        if len(self._fill):
            dead, one, other = self._fill
            cells[dead] = np.float32(0.5) * (cells[one] + cells[other])
        return cells.reshape(geometry.ROWS, geometry.COLUMNS)

    # Made when they are first asked for: a command that decodes no image needs no numpy.

    @cached_property
    def _offset(self) -> NDArray[np.float32]:
        import numpy as np

        return np.asarray(self._calibration.offset, np.float32)

    @cached_property
    def _kPa_per_eighth(self) -> NDArray[np.float32]:
        import numpy as np

        unit_kPa = self._calibration.count_mpa * 1e-6 / 8.0 / calib.UNIT_GAIN
        return np.asarray(self._calibration.gain, np.float32) * np.float32(unit_kPa)

    @cached_property
    def _fill(self) -> NDArray[np.intp]:
        """Dead cells, and the two live ones that stand in for each: (3, n), or empty."""
        import numpy as np

        known = list(self._calibration.fill)[: self._calibration.fills]
        return np.array(known, np.intp).reshape(-1, 3).T if known else np.empty(0, np.intp)


NOMINAL = CellScale()
"""The reference sensor as designed, for frames of a probe whose calibration is unknown."""


class CalibrationPieces:
    """Puts a calibration together from the answers to `read_back`, in whatever order they come."""

    def __init__(self) -> None:
        self._pieces: dict[int, bytes] = {}

    def add(self, what: int, offset: int, size: int, piece: bytes) -> CellScale | None:
        """Add one answer's fields; the whole scale once no piece is missing."""
        if what != messages.READ_CALIBRATION or size != calib.BLOB_BYTES or offset + len(piece) > size:
            return None
        if offset == 0 and self._pieces.get(0) != piece:
            self.forget()  # a new reading: no piece of an older one may get into it
        self._pieces[offset] = piece
        whole = b""
        while len(whole) < size and (more := self._pieces.get(len(whole))):
            whole += more
        if len(whole) < size:
            return None
        self.forget()
        scale = CellScale()
        return scale if scale.load(whole) else None

    def forget(self) -> None:
        """The probe's calibration has changed: pieces of the previous one are void."""
        self._pieces.clear()
