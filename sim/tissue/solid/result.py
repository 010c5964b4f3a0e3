"""A stroke over a solid lump: tactile images of the whole face. Units: mm, kPa, N."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue import face_sensors, symmetry
from palpate.sim.tissue.result import Stroke
from palpate.sim.tissue.symmetry import Mirror

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SolidStroke(Stroke):
    """Result of one simulated stroke in three dimensions.

    As a plane `Stroke`, but `images_kPa` are (n, 16, 26), along and across; `peak_mm` and `contact_mm` are
    along the stroke, wherever across it.

    Attributes
    ----------
    peak_across_mm : ndarray (n,)
        Where on the probe, across the stroke, the contact pressure is greatest.
    ramp_N : ndarray (k,)
        Smaller forces at which the image was taken too before the stroke began; none unless asked for.
    ramp_displacement_mm, ramp_images_kPa : ndarray (k,), (k, 16, 26)
        Displacements and images then, at the first position.
    """

    peak_across_mm: Floats
    ramp_N: Floats
    ramp_displacement_mm: Floats
    ramp_images_kPa: Floats

    MIRRORS: ClassVar[dict[str, Mirror]] = Stroke.MIRRORS | {
        "peak_across_mm": symmetry.SERIES,
        "ramp_images_kPa": Mirror(axes=(1,)),  # taken at the first position, whichever side that is
    }

    @property
    def across_mm(self) -> Floats:
        """Places of the sensors across the stroke, in the probe's frame."""
        return face_sensors.places_mm(self.images_kPa.shape[2])

    def to_dict(self) -> dict[str, Any]:
        """Plain lists and numbers, for JSON; `from_dict` reads them back exactly."""
        extra = ("across_mm", "peak_across_mm", "ramp_N", "ramp_displacement_mm", "ramp_images_kPa")
        out = super().to_dict() | {name: getattr(self, name).tolist() for name in extra}
        return out | {"F_N": self.case.F_N}

    @classmethod
    def from_dict(cls, record: dict[str, Any]) -> SolidStroke:
        """Read what `to_dict` wrote."""
        flat: dict[str, Any] = {
            name: np.asarray(record[name], float)
            for name in ("peak_across_mm", "ramp_N", "ramp_displacement_mm")
        }
        sensors = len(np.asarray(record["sensors_mm"])) if "sensors_mm" in record else face_sensors.ALONG
        shape = (-1, sensors, face_sensors.ACROSS)
        ramp = np.asarray(record["ramp_images_kPa"], float).reshape(shape)
        plain = cls.fields_of(record)
        plain["images_kPa"] = np.asarray(record["images_kPa"], float).reshape(shape)
        return cls(**plain | flat, ramp_images_kPa=ramp)
