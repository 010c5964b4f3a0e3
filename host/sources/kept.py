"""The calibration of an array that keeps none: a file beside the recordings. Units: kPa, raw readings.

A cell's reading rises above air by r under the pressure p = a r^b. Two numbers a cell, from the points that
`palpate calibrate gain` has taken: by least squares of the logarithms from three or more, a line
(b = 1) from fewer. Source of the law: force-sensing resistors, whose conductance goes with a power of the
force (Interlink Electronics, FSR Integration Guide).
"""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import UsageError
from palpate.files import json_text, read_whole, whole_file
from palpate.link.schemes import Address

Floats = NDArray[np.float64]
FOLDER = Path("recordings")
CURVED = 3
"""Points from which a cell has a curve of its own."""
EXPONENTS = (0.25, 4.0)
DEAD = 0.2
"""Of the median cell's rise: a cell that rises less is dead."""
MOST_BYTES = 1 << 22


@dataclass
class Kept:
    """What is known of one array.

    Parameters
    ----------
    rows, columns : int
    air : list of float
        Each cell's reading in the air; empty where it was not taken.
    points : list of dict
        {"kPa": pressure, "rise": each cell's reading above air}, one a pressure.
    zeroed : float
        Unix time of `air`, s.
    """

    rows: int
    columns: int
    air: list[float] = field(default_factory=list)
    points: list[dict[str, Any]] = field(default_factory=list)
    zeroed: float = 0.0

    def zero(self, images: Floats) -> None:
        """The mean of these images (n, rows, columns) is air."""
        self.air, self.zeroed = images.mean(axis=0).ravel().tolist(), time.time()

    def add(self, pressure_kPa: float, images: Floats) -> None:
        """The mean of these images is this pressure everywhere; one taken at it before is forgotten.

        Raises
        ------
        UsageError
            Air has not been taken, or nothing presses: the typical cell rises by less than its noise.
        """
        if not self.air:
            raise UsageError("take the zero first, in the air: palpate calibrate zero")
        rise = images.mean(axis=0).ravel() - np.array(self.air)
        noise = float(np.median(images.std(axis=0)))
        if np.median(rise) <= max(noise, 1e-9):
            raise UsageError(
                f"nothing presses: the cells rise by {np.median(rise):.2g}, and their noise is {noise:.2g}"
            )
        self.points = [point for point in self.points if point["kPa"] != pressure_kPa]
        self.points.append({"kPa": pressure_kPa, "rise": rise.tolist()})
        self.points.sort(key=lambda point: point["kPa"])

    @property
    def curves(self) -> tuple[Floats, Floats]:
        """a and b of each cell; NaN of dead ones. There must be a point."""
        p = np.array([point["kPa"] for point in self.points])
        rise = np.array([point["rise"] for point in self.points])
        alive = (rise > DEAD * np.median(rise, axis=1, keepdims=True)).all(axis=0)
        x, y = np.log(np.where(alive, rise, 1.0)), np.log(p)[:, None]
        b = np.ones(rise.shape[1])
        if len(p) >= CURVED:
            off = x - x.mean(axis=0)
            b = (off * y).sum(axis=0) / np.maximum((off**2).sum(axis=0), 1e-12)
            alive &= (b > EXPONENTS[0]) & (b < EXPONENTS[1])
        a = np.exp((y - b * x).mean(axis=0))
        return np.where(alive, a, np.nan), np.where(alive, b, np.nan)

    @property
    def dead(self) -> NDArray[np.intp]:
        """Cells that do not answer a pressure, or not as the others do."""
        return np.flatnonzero(np.isnan(self.curves[0])) if self.points else np.empty(0, np.intp)

    def misfit_kPa(self) -> float:
        """Root mean square of what the curves say of the points, less the points; NaN without any."""
        if not self.points:
            return float("nan")
        a, b = self.curves
        rise = np.array([point["rise"] for point in self.points])
        off = a * np.maximum(rise, 0) ** b - np.array([[point["kPa"]] for point in self.points])
        return float(np.sqrt(np.nanmean(off**2)))

    def save(self, path: Path) -> None:
        """Write it, whole or not at all."""
        with whole_file(path) as temporary:
            temporary.write_text(json_text(asdict(self)), encoding="utf-8")

    @classmethod
    def load(cls, path: Path, rows: int, columns: int) -> Kept:
        """Read it; an empty one where there is no file.

        Raises
        ------
        UsageError
            It is none, or one of another array.
        """
        if not path.exists():
            return cls(rows, columns)
        try:
            told = cls(**json.loads(read_whole(path, "calibration", MOST_BYTES)))
            lists = [told.air, *(point["rise"] for point in told.points)]
            sound = all(len(cells) in (0, told.rows * told.columns) for cells in lists)
            sound &= bool(np.isfinite([x for cells in lists for x in cells]).all())
            sound &= all(0 < point["kPa"] < 1e4 for point in told.points)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            sound = False
        if not sound:
            raise UsageError(f"{path} is no calibration of an array; remove it and calibrate again")
        if (told.rows, told.columns) != (rows, columns):
            raise UsageError(
                f"{path} is of an array of {told.rows} x {told.columns}, not {rows} x {columns}; "
                "name this one with name="
            )
        return told


def place(address: Address) -> Path:
    """Where an array's calibration is kept: `keep=FILE`, else by its name beside the recordings."""
    return Path(address.options.get("keep") or FOLDER / f"{address.name}.array.json")


@dataclass(frozen=True)
class Drift:
    """How the zero wanders in the air.

    Parameters
    ----------
    Pa_per_minute : float
        Of the mean over the live cells.
    worst_Pa_per_minute : float
        Of the cell that wanders most.
    seconds : float
        How long it was watched.
    """

    Pa_per_minute: float
    worst_Pa_per_minute: float
    seconds: float

    def recalibrate_after_min(self, allowed_Pa: float = 100.0) -> float:
        """Minutes until the mean has wandered by so much."""
        return allowed_Pa / max(abs(self.Pa_per_minute), 1e-9)


def drift(time_s: Floats, kPa: Floats) -> Drift:
    """The slope of pressures (n, cells) that were read in the air, by least squares."""
    t = (time_s - time_s.mean()) / 60
    slope = 1000 * (t[:, None] * (kPa - kPa.mean(axis=0))).sum(axis=0) / (t**2).sum()
    return Drift(float(np.nanmean(slope)), float(np.nanmax(np.abs(slope))), float(np.ptp(time_s)))
