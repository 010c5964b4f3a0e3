"""What the sensors have felt of one stroke and of the press before it: row means, places, displacements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.errors import PalpateError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAST_PRESS, LEAST_STROKE = 6, 12
LEAST_DISPLACEMENT_MM = 0.2
LEAST_TRAVEL_MM = 25.0
_UNEVEN = 0.03
"""A column's share of the force changes by so much of itself, noise apart, where a lump ends across: by .04
and more over balls, by .02 at most over cylinders, for the gains of cells."""

_CREEP_MM_PER_S = 60.0
"""Creep goes by time, and is told by the travel at this speed where the probe stands still."""


class NotInvertible(PalpateError):
    """The stroke lacks something that the inversion needs; the text is one sentence."""


@dataclass(frozen=True)
class FeltStroke:
    """n frames, the first `press` of them before the probe moved.

    Attributes
    ----------
    rows_kPa : ndarray (n, 16)
        Mean of the live cells of each row.
    live : ndarray (16,)
        How many cells that is.
    displacement_mm, place_mm : ndarray (n,)
    share : ndarray (n,)
        How much of the stroke is over, 0 to 1.
    along_mm : ndarray (n,)
        The clock of creep: the place, or 60 mm for each second where the probe stands still.
    press : int
    stroke : int
        Its number on the probe.
    """

    rows_kPa: Floats
    live: Ints
    displacement_mm: Floats
    place_mm: Floats
    share: Floats
    along_mm: Floats
    press: int
    stroke: int = 0

    def take(self, press: Ints, stroke: Ints) -> FeltStroke:
        """Some frames of the press and of the stroke, each counted from its own first."""
        k = np.concatenate([press, self.press + stroke])
        parts = (self.rows_kPa, self.displacement_mm, self.place_mm, self.share, self.along_mm)
        rows, depth, place, share, along = (part[k] for part in parts)
        return FeltStroke(rows, self.live, depth, place, share, along, len(press), self.stroke)


def felt_stroke(
    pressure_kPa: Floats,
    dead: NDArray[np.bool_],
    displacement_mm: Floats,
    place_mm: Floats,
    time_s: Floats,
    press: int,
    stroke: int = 0,
) -> FeltStroke:
    """Row means of n frames.

    Parameters
    ----------
    pressure_kPa : ndarray (n, 16, 26)
        By the probe's calibration; signed.
    dead : ndarray (16, 26), bool
        Cells that tell nothing.
    displacement_mm, place_mm, time_s : ndarray (n,)
    press : int
        So many of the first frames came before the probe moved.

    Raises
    ------
    NotInvertible
        No press, no displacement, too short a stroke, a row without a live cell, or a lump that ends across
        the stroke.
    """
    live = (~dead).sum(1)
    if press < LEAST_PRESS:
        raise NotInvertible(f"stroke {stroke} has no press before it: lift the probe, press, then stroke")
    if len(place_mm) - press < LEAST_STROKE or np.ptp(place_mm[press:]) < LEAST_TRAVEL_MM:
        raise NotInvertible(
            f"stroke {stroke} is too short: it takes {LEAST_STROKE} frames over {LEAST_TRAVEL_MM:g} mm"
        )
    if np.ptp(displacement_mm) < LEAST_DISPLACEMENT_MM:
        raise NotInvertible(f"stroke {stroke} has no displacement: the probe's sensor for it does not move")
    if not live.all():
        raise NotInvertible(f"stroke {stroke}: row {int(np.argmin(live))} has no live cell")
    rows = np.where(dead, 0.0, pressure_kPa).sum(2) / live
    _check_even(pressure_kPa[press:], dead, stroke)
    start = place_mm[press]
    share = np.concatenate([np.zeros(press), np.linspace(0.0, 1.0, len(place_mm) - press)])
    before = start + _CREEP_MM_PER_S * (time_s[:press] - time_s[press])
    along = np.concatenate([before, place_mm[press:]])
    place = np.concatenate([np.full(press, start), place_mm[press:]])
    return FeltStroke(rows, live, displacement_mm, place, share, along, press, stroke)


def _check_even(pressure_kPa: Floats, dead: NDArray[np.bool_], stroke: int) -> None:
    """NotInvertible where columns differ by more than gains: such a lump ends across the stroke."""
    alive = np.where(dead, np.nan, pressure_kPa)
    across = np.nanmean(alive, axis=1)  # (n, 26): the force on each column
    share = across / np.nanmean(across, axis=1, keepdims=True)
    apart = share - np.nanmean(share, axis=0)
    white = np.nanmean(np.diff(share, axis=0) ** 2, axis=0) / 2
    if np.nanmax(np.nanmean(apart**2, axis=0) - white) > _UNEVEN**2:
        raise NotInvertible(
            f"stroke {stroke}: its image changes across the stroke, as over a ball; "
            "the inversion knows endless cylinders only, so take the probe's own estimate"
        )
