"""Where on the probe's face a stroke's pressures are taken. Units: mm.

These places belong to the simulated stroke, not to the probe that feels it: strokes are kept for years, and
every sensor array takes its share of them (`palpate.sim.probe.stroke_field.on_the_array`). They are the
reference array's, which so needs no resampling; a test holds them to `firmware_py/sensor_array.py`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

ALONG = 16
ACROSS = 26
PITCH_MM = 1.5
WIDTH_MM = ACROSS * PITCH_MM
"""Across the stroke: a solid lump's probe is pressed with the force per metre times this."""


def places_mm(count: int, pitch_mm: float = PITCH_MM) -> NDArray[np.float64]:
    """Centres of a row of sensors, in the probe's frame."""
    return np.asarray(pitch_mm * (np.arange(count) - (count - 1) / 2), np.float64)


SENSORS_MM = places_mm(ALONG)
"""Centres of the sensors along the stroke."""
