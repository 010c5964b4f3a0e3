"""Counts to kPa as the probe's own calibration says, so that the picture shows what the estimate rests on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_py import calib, status


class CellScale:
    """Offset, gain and dead cells of one probe; the nominal sensor until `load`."""

    def __init__(self) -> None:
        self._take(calib.Calibration())

    def load(self, blob: bytes) -> bool:
        """Take over a calibration as the probe stores it; False (and nothing changed) if it is not one."""
        read = calib.Calibration()
        if read.load(blob) != status.OK:
            return False
        self._take(read)
        return True

    def kPa(self, counts: NDArray[np.uint16]) -> NDArray[np.float32]:
        """Pressure of a tactile image: counts (16, 26) to kPa (16, 26); dead cells from their neighbours."""
        cells = (counts.reshape(-1).astype(np.float32) * 8.0 - self._offset) * self._scale
        for cell, a, b in self._fill:
            cells[cell] = 0.5 * (cells[a] + cells[b])
        return cells.reshape(calib.ROWS, calib.COLS).astype(np.float32)

    @property
    def full_scale_kPa(self) -> float:
        """Pressure of the highest count, to a whole kPa."""
        return round(4095 * self._count_mPa * 1e-6, 1)

    def _take(self, calibration: calib.Calibration) -> None:
        self._count_mPa = calibration.count_mpa
        self._offset = np.asarray(calibration.offset, dtype=np.float32)
        gain = np.asarray(calibration.gain, dtype=np.float32) / calib.UNIT_GAIN
        self._scale = gain * np.float32(calibration.count_mpa * 1e-6 / 8.0)
        fill = list(calibration.fill)[: 3 * calibration.fills]
        self._fill = [(fill[i], fill[i + 1], fill[i + 2]) for i in range(0, len(fill), 3)]
