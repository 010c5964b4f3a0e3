"""The array's cells in the units of people: where they lie and what they read. Units: mm, kPa.

firmware_py.geometry says the same in integers. Lengths count from the middle of the face.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import geometry

PITCH_MM = geometry.PITCH_UM / 1000
ROW_MM: NDArray[Any] = PITCH_MM * (np.arange(geometry.ROWS) - (geometry.ROWS - 1) / 2)
"""Middle of each row along the stroke."""
COLUMN_MM: NDArray[Any] = PITCH_MM * (np.arange(geometry.COLUMNS) - (geometry.COLUMNS - 1) / 2)
"""Middle of each column across it."""
FULL_SCALE_KPA = geometry.FULL_SCALE_PA / 1000
PEDESTAL_KPA = geometry.PEDESTAL_PA / 1000
SHAPE = (geometry.ROWS, geometry.COLUMNS)
