"""A Gaussian on a base, fitted to a tactile map: simulated or real (thesis, Figures 10 and 20).

Units: mm, kPa.
"""

from __future__ import annotations

import itertools
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
    centre_mm: float | None = None,
    tolerance: float = 1e-11,
    most: int | None = None,
) -> tuple[Floats, float] | None:
    """Least squares of a bump between bounds on base, amp, centre and stdev; the best of several starts.

    Returns the four and the rms of the residual, or None if no start converged within `most` evaluations.
    A `centre_mm` that is given is held: its start and bounds do not count.
    """
    size = float(np.ptp(pressure)) or 1.0
    free = [0, 1, 2, 3] if centre_mm is None else [0, 1, 3]
    scale = np.array([size, size, _LENGTH_MM, _LENGTH_MM])[free]

    def whole(q: Floats) -> Floats:
        return q if centre_mm is None else np.array([q[0], q[1], centre_mm, q[2]])

    def residual(q: Floats) -> Floats:
        return (bump(x_mm, *whole(q)) - pressure) / size

    def slope(q: Floats) -> Floats:
        _, amp, centre, stdev = whole(q)
        z = (x_mm - centre) / stdev
        g = np.exp(-0.5 * z * z)
        b = amp / stdev * g * z
        return np.column_stack([np.ones_like(x_mm), g, b, b * z])[:, free] / size

    best = None
    for start in starts:
        found = least_squares(
            residual,
            np.asarray(start, float)[free],
            slope,
            bounds=(np.asarray(lower, float)[free], np.asarray(upper, float)[free]),
            x_scale=scale,
            xtol=tolerance,
            ftol=tolerance / 10,
            gtol=tolerance,
            max_nfev=most,
        )
        if found.status > 0 and (best is None or found.cost < best.cost - 1e-12):
            best = found
    if best is None:
        return None
    return whole(best.x), size * float(np.sqrt(2 * best.cost / len(x_mm)))


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
    # The tail of a stroke can look like half a Gaussian: start from several widths and places, keep the best.
    # Base and amplitude are linear, so every start has those that fit best with its centre and width.
    centres = [centre_mm] if centre_mm is not None else [float(x[np.argmax(p)]), float(x.mean())]
    starts = []
    for width, centre in itertools.product((3.0, 6.0, 12.0), centres):
        columns = np.c_[np.ones_like(x), bump(x, 0.0, 1.0, centre, width)]
        starts.append((*np.linalg.lstsq(columns, p, rcond=None)[0], centre, width))
    narrowest, widest = STDEV_RANGE_MM
    found = bounded_bump(
        x,
        p,
        starts,
        (-np.inf, -np.inf, float(x.min()), narrowest),
        (np.inf, np.inf, float(x.max()), widest),
        centre_mm,
    )
    if found is None:
        raise UsageError("no Gaussian can be fitted to this map: its search did not end")
    (base, amp, centre, stdev), rms = found
    skewness = _skewness(x, p, base, amp, centre, stdev)
    return GaussianFit(float(base), float(amp), float(centre), float(stdev), rms, skewness)


def _skewness(x: Floats, p: Floats, base: float, amp: float, centre: float, stdev: float) -> float:
    z = (x - centre) / stdev
    bell = amp * np.exp(-z * z / 2)
    # Base, height, centre and width may shift beside the cubic term: only what they leave is skewness.
    columns = np.c_[np.ones_like(z), bell, bell * z, bell * z * z, bell * (z**3 - 3 * z) / 6]
    if abs(amp) < 1e-12 or np.linalg.matrix_rank(columns) < columns.shape[1]:
        return 0.0
    return float(np.linalg.lstsq(columns, p - base - bell, rcond=None)[0][-1])
