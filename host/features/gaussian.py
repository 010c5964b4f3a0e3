"""A Gaussian on a base, fitted to a tactile map: simulated or real (thesis, Figures 10 and 20).

Units: mm, kPa.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from palpate.errors import UsageError

Floats = NDArray[np.float64]

STDEV_RANGE_MM = (1.0, 25.0)
_LENGTH_MM = 3.0  # of a step in centre and stdev


def bump(x_mm: ArrayLike, base: float, amp: float, centre: float, stdev: float) -> Floats:
    """base + amp exp(-(x - centre)^2 / (2 stdev^2))."""
    z = (np.asarray(x_mm, float) - centre) / stdev
    return base + amp * np.exp(-z * z / 2)


def bounded_bump(
    x_mm: NDArray[Any],
    pressure: NDArray[Any],
    starts: Sequence[Sequence[float]],
    lower: Sequence[float],
    upper: Sequence[float],
    tolerance: float = 1e-11,
    most: int | None = None,
) -> tuple[Floats, float] | None:
    """Least squares of a bump between bounds on base, amp, centre and stdev; the best of several starts.

    Returns the four and the rms of what they leave, or None if no start ended within `most` evaluations.
    """
    size = float(np.ptp(pressure)) or 1.0

    def residual(p: Floats) -> Floats:
        return (bump(x_mm, *p) - pressure) / size

    def slope(p: Floats) -> Floats:
        z = (x_mm - p[2]) / p[3]
        g = np.exp(-0.5 * z * z)
        b = p[1] / p[3] * g * z
        return np.column_stack([np.ones_like(x_mm), g, b, b * z]) / size

    best = None
    for start in starts:
        found = least_squares(
            residual,
            start,
            slope,
            bounds=(lower, upper),
            x_scale=[size, size, _LENGTH_MM, _LENGTH_MM],
            xtol=tolerance,
            ftol=tolerance / 10,
            gtol=tolerance,
            max_nfev=most,
        )
        if found.status > 0 and (best is None or found.cost < best.cost - 1e-12):
            best = found
    if best is None:
        return None
    return best.x, size * float(np.sqrt(2 * best.cost / len(x_mm)))


@dataclass(frozen=True)
class GaussianFit:
    """A Gaussian on a base, fitted to a tactile map by least squares.

    Attributes
    ----------
    base_kPa, amp_kPa, centre_mm, stdev_mm : float
        p(x) = base + amp exp(-(x - centre)^2 / (2 stdev^2)).
    rms_kPa : float
        Root mean square of the residual.
    skewness : float
        Third standardised moment of the bump, as the Gram-Charlier term (skewness / 6) (z^3 - 3 z)
        that explains most of the residual; 0 for a symmetric map, positive with the longer tail
        towards larger x.
    """

    base_kPa: float
    amp_kPa: float
    centre_mm: float
    stdev_mm: float
    rms_kPa: float
    skewness: float

    def curve(self, x_mm: ArrayLike) -> Floats:
        """The fitted pressure (kPa) at `x_mm`."""
        return bump(x_mm, self.base_kPa, self.amp_kPa, self.centre_mm, self.stdev_mm)


def fit_gaussian(x_mm: ArrayLike, pressure_kPa: ArrayLike, centre_mm: float | None = None) -> GaussianFit:
    """Fit a Gaussian on a base to a tactile map, a simulated or a real one (thesis, Figures 10 and 20).

    Parameters
    ----------
    x_mm, pressure_kPa : arrays, n >= 5
    centre_mm : float, optional
        Hold the centre there; by default it is fitted too.

    Raises
    ------
    UsageError
        Fewer than five points, or one that is not finite.
    """
    x, p = np.asarray(x_mm, float), np.asarray(pressure_kPa, float)
    if x.shape != p.shape or x.ndim != 1 or len(x) < 5:
        raise UsageError("a map needs at least five places, each with one pressure")
    if not (np.isfinite(x).all() and np.isfinite(p).all()):
        raise UsageError("the map holds a value that is not finite")
    span = float(np.ptp(p)) or 1.0
    lo, hi = STDEV_RANGE_MM

    def parts(q: Floats) -> tuple[Floats, Floats]:
        z = (x - (q[1] if centre_mm is None else centre_mm)) / np.exp(q[0])
        columns = np.c_[np.ones_like(z), np.exp(-z * z / 2)]
        return columns, np.linalg.lstsq(columns, p, rcond=None)[0]

    def residual(q: Floats) -> Floats:
        columns, weights = parts(q)
        return (columns @ weights - p) / span

    # Base and amplitude are linear, so only centre and stdev are searched (variable projection). A tail
    # of the stroke can look like half a Gaussian: start from several widths and places, keep the best.
    starts = [0.0] if centre_mm is not None else [float(x[np.argmax(p)]), float(x.mean())]
    low, high = [np.log(lo)], [np.log(hi)]
    if centre_mm is None:
        low, high = [*low, float(x.min())], [*high, float(x.max())]
    best = None
    for width in (3.0, 6.0, 12.0):
        for start in starts:
            q0 = np.array([np.log(width)] if centre_mm is not None else [np.log(width), start])
            found = least_squares(
                residual, np.clip(q0, low, high), bounds=(low, high), xtol=1e-12, ftol=1e-12
            )
            if best is None or found.cost < best.cost:
                best = found
    assert best is not None
    columns, (base, amp) = parts(best.x)
    left = p - columns @ [base, amp]
    stdev = float(np.exp(best.x[0]))
    centre = float(best.x[1]) if centre_mm is None else centre_mm
    return GaussianFit(
        float(base),
        float(amp),
        centre,
        stdev,
        float(np.sqrt(np.mean(left**2))),
        _skewness(x, p, base, amp, centre, stdev),
    )


def _skewness(x: Floats, p: Floats, base: float, amp: float, centre: float, stdev: float) -> float:
    z = (x - centre) / stdev
    bell = amp * np.exp(-z * z / 2)
    # Base, height, centre and width may shift beside the cubic term: only what they leave is skewness.
    columns = np.c_[np.ones_like(z), bell, bell * z, bell * z * z, bell * (z**3 - 3 * z) / 6]
    if abs(amp) < 1e-12 or np.linalg.matrix_rank(columns) < columns.shape[1]:
        return 0.0
    return float(np.linalg.lstsq(columns, p - base - bell, rcond=None)[0][-1])
