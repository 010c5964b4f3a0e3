"""The smallest and largest value of a case's numbers that makes sense. Units as in `case.py`."""

import math

from palpate.sim.tissue.layers import UNDER_FAT, fields_of

_MAIN: dict[str, tuple[float, float]] = {
    "d_mm": (0.5, 100.0),
    "h": (0.02, 50.0),
    "E_ratio": (0.01, 1e6),
    "F_rel": (1e-3, 100.0),
}
_OPTIONS: dict[str, tuple[float, float]] = {
    "probe_radius_mm": (5.0, math.inf),
    "face_half_mm": (0.0, 40.0),
    "fillet_per_mm2": (0.005, 10.0),
    "friction": (0.0, 0.5),
    "fat_kPa": (0.01, 10000.0),
    "poisson": (0.3, 0.49999),
    "fat_stiffening": (0.0, 2000.0),
    "lump_stiffening": (0.0, 2000.0),
    "fat_mm": (0.3, 200.0),
    "padding_mm_per_kPa": (0.0, 1.0),
}
for _layer in UNDER_FAT:
    _OPTIONS |= dict(zip(fields_of(_layer), ((1.0, 200.0), (0.1, 1000.0), (0.0, 2000.0))))
ONLY_SOLID: dict[str, tuple[float, float]] = {
    "half_across_mm": (0.25, 1000.0),
    "half_down_mm": (0.25, 50.0),
    "offset_mm": (-30.0, 30.0),
    "across_radius_mm": (20.0, math.inf),
    "across_half_mm": (0.0, 100.0),
    "across_fillet_per_mm2": (0.005, 10.0),
}
"""What only a ball or an ellipsoid can have."""

LIMITS = _MAIN | _OPTIONS | ONLY_SOLID
