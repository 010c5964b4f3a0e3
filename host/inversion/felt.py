"""What the sensors have felt of a stroke and its press, or of a press alone: rows, places, displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.errors import PalpateError
from palpate.link.face import Face
from palpate.sim.probe.creep import Lag

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAST_PRESS, LEAST_STROKE = 6, 12
LEAST_DISPLACEMENT_MM = 0.2
LEAST_TRAVEL_MM = 25.0
LEAST_RISE = 2.0
"""By so much the force of a press alone must grow."""
_TOUCHES = 0.1
_OWN = Face(40.0)
"""Of our probe."""
_UNEVEN, _SIDE_BY_SIDE = 0.010, 4
"""The share of the force on columns side by side changes by so much of itself, noise apart, where a lump ends
across: over sixty cylinders by .008 at most, for the gains of cells; over balls by more, unless they are deep
or soft."""
_BENT = 0.04
"""Where the face's sides are felt, columns' mean pressures depart from each other by more of themselves, in
the root mean square of a parabola and a quartic: over balls by .057 and more, over tissue alone by .05, over
endless cylinders by .012 at most, and by .06 in nine of ten where sensors are as noisy as `real`."""

_PRESSED_UNEVENLY = 0.06
"""In a press over five balls a column gains .09 to .19 more or less than its rows; over twelve cylinders, by
probes of `typical` noise, .04 at most, where the force is least."""
_CREEP_MM_PER_S = 60.0
"""Creep goes by time, and is told by the travel at this speed where the probe stands still."""


class NotInvertible(PalpateError):
    """The stroke or press lacks something that the inversion needs; the text is one sentence."""


@dataclass(frozen=True)
class FeltStroke:
    """n frames, the first `press` of them before the probe moved: all of them, where it never did.

    Attributes
    ----------
    rows_kPa : ndarray (n, rows)
        Mean of the live cells of each row.
    live : ndarray (rows,)
        How many cells that is.
    displacement_mm, place_mm : ndarray (n,)
    share : ndarray (n,)
        How much of the stroke is over, 0 to 1.
    along_mm : ndarray (n,)
        The clock of creep: the place, or 60 mm for each second where the probe stands still.
    press : int
    stroke : int
        Its number on the probe; of a press alone in its recording.
    face : Face
    measured : bool
        Whether the displacement is; else it is 0 and counts for nothing.
    curve_kPa : float
        Standard deviation of what the cells' response curves get wrong, row by row.
    image_kPa : ndarray (n, rows, columns), optional
        Every cell, dead ones NaN.
    solid : bool
        Whether the lump under it, or the tissue beside the face, ends across the stroke.
    each : ndarray (n,), optional
        Each frame is the mean of so many.
    lag : ndarray (n, n), optional
        What of every frame's pressure is in the slow part of each; None: by the clock.
    """

    rows_kPa: Floats
    live: Ints
    displacement_mm: Floats
    place_mm: Floats
    share: Floats
    along_mm: Floats
    press: int
    stroke: int = 0
    face: Face = _OWN
    measured: bool = True
    curve_kPa: float = 0.0
    image_kPa: Floats | None = None
    solid: bool = False
    each: Ints | None = None
    lag: Floats | None = None

    @property
    def alone(self) -> bool:
        """Whether it is a press without a stroke."""
        return self.press == len(self.place_mm)

    @property
    def frames(self) -> Ints:
        """Of how many frames each is the mean, (n,)."""
        return np.ones(len(self.place_mm), np.int64) if self.each is None else self.each

    def slow(self, pressure: Floats) -> Floats:
        """The slow part of what frames read (n, q)."""
        return Lag().follow(pressure, self.along_mm) if self.lag is None else self.lag @ pressure

    def take(self, press: Ints, stroke: Ints) -> FeltStroke:
        """Some frames of the press and of the stroke, each counted from its own first."""
        return self.means(list(press[:, None]), list(stroke[:, None]))

    def means(self, press: Sequence[Ints], stroke: Sequence[Ints]) -> FeltStroke:
        """Means of neighbours in the press and in the stroke, each counted from its own first."""
        groups = [*press, *(self.press + group for group in stroke)]
        n = len(self.place_mm)
        mean = np.zeros((len(groups), n))
        for weights, group in zip(mean, groups):
            weights[group] = 1 / len(group)
        images = self.image_kPa
        return replace(
            self, rows_kPa=mean @ self.rows_kPa, displacement_mm=mean @ self.displacement_mm,
            place_mm=mean @ self.place_mm, share=mean @ self.share, along_mm=mean @ self.along_mm,
            press=len(press), lag=mean @ self.slow(_between(mean @ np.arange(n), n)),
            image_kPa=None if images is None else np.tensordot(mean, images, 1),
            each=np.array([self.frames[group].sum() for group in groups]),
        )  # fmt: skip


def _between(taken: Floats, n: int) -> Floats:
    """What n frames have of those that were taken: along lines between them, and before the first."""
    frame, out = np.arange(n), np.zeros((n, len(taken)))
    if len(taken) == 1:
        return out + 1.0
    after = np.clip(np.searchsorted(taken, frame), 1, len(taken) - 1)
    share = np.minimum((frame - taken[after - 1]) / (taken[after] - taken[after - 1]), 1.0)
    out[frame, after], out[frame, after - 1] = share, 1 - share
    return out


def felt_stroke(
    pressure_kPa: Floats,
    dead: NDArray[np.bool_],
    displacement_mm: Floats,
    place_mm: Floats,
    time_s: Floats,
    press: int,
    stroke: int = 0,
    face: Face | None = None,
) -> FeltStroke:
    """Row means and cells of n frames of a stroke, and whether its lump ends across it.

    Parameters
    ----------
    pressure_kPa : ndarray (n, rows, columns)
        By the probe's calibration; signed.
    dead : ndarray (rows, columns), bool
        Cells that tell nothing.
    displacement_mm, place_mm, time_s : ndarray (n,)
    press : int
        So many of the first frames came before the probe moved.
    face : Face, optional
        The probe's own unless told.

    Raises
    ------
    NotInvertible
        No press, no displacement, too short a stroke, a row without a live cell, or another face over a lump
        that ends across the stroke.
    """
    if press < LEAST_PRESS:
        raise NotInvertible(f"stroke {stroke} has no press before it: lift the probe, press, then stroke")
    if len(place_mm) - press < LEAST_STROKE or np.ptp(place_mm[press:]) < LEAST_TRAVEL_MM:
        raise NotInvertible(
            f"stroke {stroke} is too short: it takes {LEAST_STROKE} frames over {LEAST_TRAVEL_MM:g} mm"
        )
    if np.ptp(displacement_mm) < LEAST_DISPLACEMENT_MM:
        raise NotInvertible(f"stroke {stroke} has no displacement: the probe's sensor for it does not move")
    rows = _rows(pressure_kPa, dead, f"stroke {stroke}")
    even = _even(pressure_kPa[press:], dead)
    flat = face is not None or _flat(pressure_kPa[press:], dead)
    if not even and face is not None:
        raise NotInvertible(
            f"stroke {stroke}: its image changes across the stroke, as over a ball, which the inversion "
            "knows under Palpate's own probe only"
        )
    start = place_mm[press]
    share = np.concatenate([np.zeros(press), np.linspace(0.0, 1.0, len(place_mm) - press)])
    before = start + _CREEP_MM_PER_S * (time_s[:press] - time_s[press])
    place = np.concatenate([np.full(press, start), place_mm[press:]])
    face = face or _OWN
    live = (~dead).sum(1)
    along = np.concatenate([before, place_mm[press:]])
    return FeltStroke(
        rows, live, displacement_mm, place, share, along, press, stroke, face,
        image_kPa=np.where(dead, np.nan, pressure_kPa), solid=not (even and flat),
    )  # fmt: skip


def felt_press(
    pressure_kPa: Floats,
    dead: NDArray[np.bool_],
    displacement_mm: Floats,
    time_s: Floats,
    number: int = 0,
    face: Face | None = None,
) -> FeltStroke:
    """Row means of a press alone, from contact to its greatest force; parameters as of `felt_stroke`.

    displacement_mm : ndarray (n,)
        Where it does not change, it was not measured.

    Raises
    ------
    NotInvertible
        Too few frames, a force that does not grow, a row without a live cell, or a lump that ends across.
    """
    name = f"press {number}"
    rows = _rows(pressure_kPa, dead, name)
    force = rows.sum(1)
    most = int(np.argmax(force))
    k = np.flatnonzero((force >= _TOUCHES * force[most]) & (np.arange(len(force)) <= most))
    if len(k) < LEAST_PRESS or force[most] < LEAST_RISE * force[k[0]]:
        raise NotInvertible(
            f"{name} is too quick: it takes {LEAST_PRESS} frames in which the force grows at least twofold"
        )
    _check_pressed_evenly(pressure_kPa[k], dead, name)
    depth = displacement_mm[k]
    measured = bool(np.ptp(depth) >= LEAST_DISPLACEMENT_MM)
    nothing = np.zeros(len(k))
    return FeltStroke(
        rows[k], (~dead).sum(1), depth if measured else nothing, nothing, nothing,
        _CREEP_MM_PER_S * (time_s[k] - time_s[k[-1]]), len(k), number,
        face or _OWN, measured,
    )  # fmt: skip


def _rows(pressure_kPa: Floats, dead: NDArray[np.bool_], name: str) -> Floats:
    """Means (n, rows) of the live cells."""
    live = (~dead).sum(1)
    if not live.all():
        raise NotInvertible(f"{name}: row {int(np.argmin(live))} has no live cell")
    rows: Floats = np.where(dead, 0.0, pressure_kPa).sum(2) / live
    if not np.isfinite(rows).all():
        raise NotInvertible(f"{name}: a cell's pressure is no number; look at the calibration")
    return rows


def _even(pressure_kPa: Floats, dead: NDArray[np.bool_]) -> bool:
    """Whether columns differ by gains alone; else the lump ends across the stroke."""
    rows = np.nanmean(np.where(dead, np.nan, pressure_kPa), axis=2, keepdims=True)
    # a dead cell that is left out takes its row's part of a narrow bump from its column
    across = np.where(dead, rows, pressure_kPa).mean(axis=1)  # (n, 26): the force on each column
    share = across / across.mean(axis=1, keepdims=True)
    sums = np.cumsum(np.pad(share, ((0, 0), (1, 0))), axis=1)
    share = (sums[:, _SIDE_BY_SIDE:] - sums[:, :-_SIDE_BY_SIDE]) / _SIDE_BY_SIDE
    apart = share - share.mean(axis=0)
    white = (np.diff(share, axis=0) ** 2).mean(axis=0) / 2
    return bool(((apart**2).mean(axis=0) - white).max() <= _UNEVEN**2)


def _flat(pressure_kPa: Floats, dead: NDArray[np.bool_]) -> bool:
    """Whether the face's sides are not felt: then tissue and lump are endless across the stroke."""
    live = dead.sum(axis=0) < len(dead)
    columns = np.nanmean(np.where(dead, np.nan, pressure_kPa)[:, :, live], axis=(0, 1))
    across = np.linspace(-1.0, 1.0, len(live))[live]
    level, *bent = np.linalg.qr(across[:, None] ** [0, 2, 4])[0].T @ columns
    return bool(np.hypot(*bent) <= _BENT * abs(level))


def _check_pressed_evenly(pressure_kPa: Floats, dead: NDArray[np.bool_], name: str) -> None:
    """NotInvertible where columns differ in a press, by what each gains with the force: zeros drop out."""
    alive = np.where(dead, np.nan, pressure_kPa)
    rise = alive - alive.mean(axis=0)
    of_row = np.where(dead, np.nan, np.nanmean(rise, axis=2, keepdims=True))
    gain = np.nansum(rise * of_row, axis=(0, 1)) / np.nansum(of_row**2, axis=(0, 1))
    if np.abs(gain - 1).max() > _PRESSED_UNEVENLY:
        raise NotInvertible(
            f"{name}: its image changes across the stroke, as over a ball; "
            "of a press alone the inversion knows endless cylinders only"
        )
