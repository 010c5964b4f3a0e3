"""Features of a stroke in float64: the reference that the probe's integer features are checked against.

A stroke is anything that has `positions_mm`, `displacement_mm`, `sensors_mm` and `images_kPa`
(position x sensor), as a finite-element stroke or a recording does. Definitions are those of the
thesis, "Feature Extraction" (its Figures 9 to 11).

Units: mm, kPa.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from palpate.errors import UsageError
from palpate.features.gaussian import Floats, GaussianFit, fit_gaussian
from palpate.sim.tissue.symmetry import both_sides

__all__ = [
    "Floats",
    "GaussianFit",
    "StrokeFeatures",
    "StrokeLike",
    "curvature",
    "fit_gaussian",
    "map_grid_mm",
    "peak_jumps",
    "peak_trace",
    "stroke_features",
    "tactile_map",
    "whole_stroke",
]

MAP_HALF_MM = 28.0
CURVATURE_AT_MM = 8.0
_FAR_MM = np.array([-80.0, -60.0, -40.0])


class StrokeLike(Protocol):
    """What a stroke must offer: K positions, S sensors along the stroke."""

    @property
    def positions_mm(self) -> Floats:
        """Places of the probe's middle (n,), mm."""

    @property
    def displacement_mm(self) -> Floats:
        """Displacements (n,), mm."""

    @property
    def sensors_mm(self) -> Floats:
        """Places of the sensors on the face (16,), mm."""

    @property
    def images_kPa(self) -> Floats:
        """Pressures (n, 16), kPa."""


@dataclass(frozen=True)
class StrokeFeatures:
    """The output parameters of one stroke (thesis, "Definition of Output Parameters").

    `curvature` is the pressure at the probe's centre over the mean of those 8 mm to either side, with
    the probe 28 mm from the lump; `D28_mm` and `D0_mm` are its displacement there and over the lump.
    """

    base_kPa: float
    amp_kPa: float
    stdev_mm: float
    curvature: float
    D28_mm: float
    D0_mm: float
    rms_kPa: float

    def strain(self, t_mm: float) -> tuple[float, float]:
        """Nominal strain of fat `t_mm` thick, at 28 mm and over the lump."""
        return self.D28_mm / t_mm, self.D0_mm / t_mm

    def relative_to(self, reference: StrokeFeatures) -> dict[str, float]:
        """Every feature over that of the reference case (d10h08e10f10 in the thesis)."""
        mine, its = asdict(self), asdict(reference)
        return {name: mine[name] / its[name] for name in mine}


def map_grid_mm(increment_mm: float = 1.0, half_mm: float = MAP_HALF_MM) -> Floats:
    """Places of a tactile map from -half to +half; `increment_mm` must divide the half exactly."""
    steps = half_mm / increment_mm if increment_mm > 0 else 0.0
    if steps < 1 or abs(steps - round(steps)) > 1e-9:
        raise UsageError(f"an increment of {increment_mm:g} mm does not divide {half_mm:g} mm")
    n = round(steps)
    return np.linspace(-half_mm, half_mm, 2 * n + 1)


def whole_stroke(stroke: StrokeLike) -> tuple[Floats, Floats, Floats]:
    """Positions (K), images (K x S) and displacement (K) of the stroke over both sides of the lump.

    A simulated stroke ends over the lump; the tissue is symmetric, so its second half is the first mirrored.
    """
    x, p, d = (np.asarray(a, float) for a in (stroke.positions_mm, stroke.images_kPa, stroke.displacement_mm))
    order = np.argsort(x, kind="stable")
    x, p, d = x[order], p[order], d[order]
    x, p, d = both_sides(x, p, d)
    return x, p, d


def tactile_map(stroke: StrokeLike, method: int = 2, x_mm: ArrayLike | None = None) -> tuple[Floats, Floats]:
    """The stroke's images put together (thesis, Figure 9).

    Parameters
    ----------
    stroke : StrokeLike
        Half strokes are mirrored.
    method : int
        1: the images are laid side by side on the tissue and averaged where they overlap.
        2: each sensor's pressure is traced over the tissue, interpolated, and the traces are averaged.
    x_mm : array, optional
        Places of the map on the tissue; by default every millimetre from -28 to 28.

    Returns
    -------
    x_mm, pressure_kPa : arrays of equal length

    Raises
    ------
    UsageError
        Any other method.
    """
    grid = map_grid_mm() if x_mm is None else np.asarray(x_mm, float)
    x, images, _ = whole_stroke(stroke)
    sensors = np.asarray(stroke.sensors_mm, float)
    if method == 1:
        return grid, _average_images(grid, x, images, sensors)
    if method == 2:
        return grid, _average_traces(grid, x, images, sensors)
    raise UsageError(f"there is a Method 1 and a Method 2, no Method {method}")


def _average_images(grid: Floats, x: Floats, images: Floats, sensors: Floats) -> Floats:
    total, count = np.zeros(len(grid)), np.zeros(len(grid))
    for at, image in zip(x, images):
        inside = (grid >= at + sensors[0] - 1e-9) & (grid <= at + sensors[-1] + 1e-9)
        total[inside] += np.interp(grid[inside] - at, sensors, image)
        count += inside
    if not count.all():
        raise UsageError("the stroke does not cover the whole map")
    return total / count


def _average_traces(grid: Floats, x: Floats, images: Floats, sensors: Floats) -> Floats:
    # A trace is taken as constant beyond the stroke's ends: the probe is far from the lump there.
    before, after = _FAR_MM[x[0] - _FAR_MM > 1], -_FAR_MM[::-1]
    far = before, after[after - x[-1] > 1]
    places = np.r_[far[0], x, far[1]]
    traces = np.r_[np.repeat(images[:1], len(far[0]), 0), images, np.repeat(images[-1:], len(far[1]), 0)]
    return np.mean(
        [PchipInterpolator(places + s, trace)(grid) for s, trace in zip(sensors, traces.T)], axis=0
    )


def curvature(stroke: StrokeLike, at_mm: float = -MAP_HALF_MM, aside_mm: float = CURVATURE_AT_MM) -> float:
    """Centre pressure over the mean of those `aside_mm` to either side, the probe at `at_mm` (Figure 10)."""
    x, images, _ = whole_stroke(stroke)
    image = np.array([np.interp(at_mm, x, trace) for trace in images.T])
    left, centre, right = np.interp([-aside_mm, 0.0, aside_mm], stroke.sensors_mm, image)
    return float(centre / max((left + right) / 2, 1e-3))


def stroke_features(stroke: StrokeLike, method: int = 2, increment_mm: float = 1.0) -> StrokeFeatures:
    """All output parameters of one stroke over a lump at position 0."""
    x, _, displacement = whole_stroke(stroke)
    fit = fit_gaussian(*tactile_map(stroke, method, map_grid_mm(increment_mm)), centre_mm=0.0)
    D28, D0 = np.interp([-MAP_HALF_MM, 0.0], x, displacement)
    return StrokeFeatures(
        fit.base_kPa, fit.amp_kPa, fit.stdev_mm, curvature(stroke), float(D28), float(D0), fit.rms_kPa
    )


def peak_trace(stroke: StrokeLike) -> tuple[Floats, Floats]:
    """Where on the tissue each image of the stroke is highest, and how high (thesis, Figure 11, bottom).

    Returns
    -------
    place_mm, pressure_kPa : arrays (K)
        Of the contact pressure itself where the stroke has it (`peak_mm`, `peak_kPa`), as a simulated one
        does; otherwise a parabola through the highest sensor and its neighbours places the peak.
    """
    peaks = getattr(stroke, "peak_mm", None), getattr(stroke, "peak_kPa", None)
    if peaks[0] is not None and peaks[1] is not None:
        return stroke.positions_mm + peaks[0], np.array(peaks[1], float)
    sensors = np.asarray(stroke.sensors_mm, float)
    images = np.asarray(stroke.images_kPa, float)
    top = np.clip(images.argmax(1), 1, len(sensors) - 2)
    rows = np.arange(len(images))
    a, b, c = (images[rows, top + k] for k in (-1, 0, 1))
    bend = a - 2 * b + c
    shift = np.where(bend < 0, np.clip(0.5 * (a - c) / np.where(bend < 0, bend, -1.0), -1.0, 1.0), 0.0)
    pitch = sensors[1] - sensors[0]
    return stroke.positions_mm + sensors[top] + shift * pitch, b - 0.25 * (a - c) * shift


def peak_jumps(stroke: StrokeLike, threshold_mm: float = 1.5) -> list[tuple[float, float]]:
    """Jumps of the peak ahead of the probe: (probe position after it, how far beyond its own step), both mm.

    Once at the lump, the peak stays there while the probe moves on; that is not a jump.
    """
    place, _ = peak_trace(stroke)
    beyond = np.diff(place) - np.diff(stroke.positions_mm)
    jumped = np.flatnonzero(beyond > threshold_mm)
    return [(float(stroke.positions_mm[k + 1]), float(beyond[k])) for k in jumped]
