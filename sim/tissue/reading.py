"""How pressures at the nodes of the skin, along the stroke, are read by a row of sensors. Units: mm, kPa."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.border import last_over_next, mean_pressure_changes, mean_pressures
from palpate.sim.tissue.face_sensors import ALONG, PITCH_MM, places_mm

Floats = NDArray[np.float64]

_SAMPLE_WEIGHTS = np.array([0.5, *[1.0] * 7, 0.5]) / 8


def places_read(count: int, pitch_mm: float) -> Floats:
    """Where a row of sensors is read, (count, 9), mm: nine places over each."""
    return places_mm(count, pitch_mm)[:, None] + np.linspace(-pitch_mm / 2, pitch_mm / 2, 9)


OWN_PLACES = places_read(ALONG, PITCH_MM)
"""Of `SENSORS_MM`."""


def read_sensors(s_mm: Floats, pressure_kPa: Floats, at: Floats = OWN_PLACES) -> Floats:
    """Mean pressure over each sensor, kPa, of a profile that is straight from node to node.

    s_mm (S,): places in the probe's frame, ascending; pressure_kPa (S,); at (n, 9): `places_read`.
    """
    return np.interp(at.ravel(), s_mm, pressure_kPa).reshape(at.shape) @ _SAMPLE_WEIGHTS


class Reading:
    """How pressures at the skin's nodes are read by sensors.

    Parameters
    ----------
    x0_mm : ndarray (S,)
        The nodes, undeformed.
    to_border : bool
        Up to the contact's border between them, and exactly; otherwise straight from node to node, at nine
        places over each sensor.
    """

    def __init__(self, x0_mm: Floats, to_border: bool) -> None:
        self._ratios = last_over_next(x0_mm) if to_border else None

    def __call__(self, s_mm: Floats, pressure_kPa: Floats, at: Floats = OWN_PLACES) -> Floats:
        """Mean pressure over each sensor, kPa; the parameters are those of `read_sensors`."""
        if self._ratios is not None:
            means: Floats = mean_pressures(s_mm, pressure_kPa, self._ratios, _ends(at))
            return means
        return read_sensors(s_mm, pressure_kPa, at)

    def differentiate(
        self, s_mm: Floats, pressure_kPa: Floats, ds: Floats, dp: Floats, at: Floats = OWN_PLACES
    ) -> Floats:
        """How it changes (k, n) with changes ds, dp (k, S) of the profile's places and pressures."""
        if self._ratios is None:
            return _differentiate_straight(s_mm, pressure_kPa, ds, dp, at)
        changes: Floats = mean_pressure_changes(s_mm, pressure_kPa, ds, dp, self._ratios, _ends(at))
        return changes


def _ends(at: Floats) -> Floats:
    return np.ascontiguousarray(at[:, [0, -1]])


def _differentiate_straight(
    s_mm: Floats, pressure_kPa: Floats, ds: Floats, dp: Floats, sensors: Floats
) -> Floats:
    at = sensors.ravel()
    i = np.clip(np.searchsorted(s_mm, at, side="right") - 1, 0, len(s_mm) - 2)
    length, inside = s_mm[i + 1] - s_mm[i], at - s_mm[i]
    share = inside / length
    moved = -(ds[:, i] * (1 - share) + ds[:, i + 1] * share) / length
    change = dp[:, i] * (1 - share) + dp[:, i + 1] * share + (pressure_kPa[i + 1] - pressure_kPa[i]) * moved
    out: Floats = change.reshape(len(ds), *sensors.shape) @ _SAMPLE_WEIGHTS
    return out
