"""What a stroke itself tells of a lump: a bound, by Fisher's information.

Every channel of every frame of a stroke and of the press before it counts, whatever features an estimate may
be made of; a channel is a cell, or a row of cells that read alike. What else is not known (tissue, face, the
hand's force and place in every frame, gains, zeros) is estimated too, with what is known of it beforehand.
The channels' own gains and zeros enter as a covariance, inverted by Woodbury's formula. No unbiased estimate,
and no posterior in a nearly linear world, is narrower. Units: mm, kPa.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.sim.probe.noise import Noise
from palpate.wire.cells import FULL_SCALE_KPA

MEDIAN_OF_SD = 0.6745
"""Median of a normal error over its standard deviation."""

PRESS_FRAMES = 4
"""Frames near each of the forces at which the press is looked at."""

_FORCE_SD = 0.05
"""Of a force that wanders by 10 % at most."""
_START_SD_MM = 3.0


@dataclass(frozen=True)
class Felt:
    """Pressures of all channels and the displacement, frame by frame: the press's, then the stroke's.

    values, slope : (frames, channels + 1), and per mm of the way; x_mm : (frames); press : (frames), bool;
    cells : int, that a channel is the mean of
    """

    values: Floats
    slope: Floats
    x_mm: Floats
    press: NDArray[np.bool_]
    cells: int


@dataclass(frozen=True)
class Bound:
    """`covariance` of `names` where the stroke, its press and the priors are all that is known."""

    names: tuple[str, ...]
    covariance: Floats

    def sd(self, name: str) -> float:
        """Standard deviation of one of `names`."""
        return self.sd_of({name: 1.0})

    def sd_of(self, weights: Mapping[str, float]) -> float:
        """Standard deviation of a weighted sum, by name."""
        w = np.array([weights.get(name, 0.0) for name in self.names])
        return float(np.sqrt(max(w @ self.covariance @ w, 0.0)))

    def told(self, name: str) -> Bound:
        """The bound where this one is known."""
        k, c = self.names.index(name), self.covariance
        return Bound(self.names, c - np.outer(c[k], c[k]) / (c[k, k] + 1e-15))

    def combined(self) -> tuple[float, float]:
        """c and the standard deviation of ln d + c E^-2/3, the combination known best."""
        d, e = self.names.index("ln d"), self.names.index("E^-2/3")
        c = -float(self.covariance[d, e] / self.covariance[e, e])
        return c, self.sd_of({"ln d": 1.0, "E^-2/3": c})


def bound(
    seen: Felt, derivatives: Mapping[str, Floats], of_force: Floats, priors: Sequence[float], noise: Noise
) -> Bound:
    """The bound of one stroke.

    Parameters
    ----------
    seen : Felt
    derivatives : name -> (frames, channels + 1)
        Of `seen.values`, by each parameter but force and fat.
    of_force : (frames, channels + 1)
        The same by ln F.
    priors : sequence
        Spreads of the parameters over the design, then of ln F and ln E_fat.
    noise : Noise
    """
    pressure = np.arange(seen.values.shape[1]) < seen.values.shape[1] - 1
    # more modulus at the same force over it: all pressures rise, displacements stay
    columns = [*derivatives.values(), of_force, seen.values * pressure - of_force]
    disturbed = [
        (signal, sd) for signal, sd in _disturbances(seen, of_force, noise) if sd > 0 and signal.any()
    ]
    often = np.where(seen.press, np.sqrt(PRESS_FRAMES), 1.0)[:, None]
    A = np.stack([*columns, *(signal for signal, _ in disturbed)], axis=2) * often[:, :, None]
    H = A[:, -1].T @ A[:, -1] / noise.displacement_noise_mm**2
    white = noise.white * FULL_SCALE_KPA
    spreads = np.array([noise.gain, noise.offset * FULL_SCALE_KPA]) / white
    for k in np.flatnonzero(pressure):
        own = A[:, k]
        B = often * np.column_stack([seen.values[:, k], np.ones(len(own))]) * spreads
        across = B.T @ own
        H += (own.T @ own - across.T @ np.linalg.solve(np.eye(2) + B.T @ B, across)) * seen.cells / white**2
    H += np.diag(np.array([*priors, *(sd for _, sd in disturbed)]) ** -2.0)
    names = (*derivatives, "ln F", "ln E_fat")
    return Bound(names, np.linalg.inv(H)[: len(names), : len(names)].astype(np.float64))


def _disturbances(seen: Felt, of_force: Floats, n: Noise) -> Iterator[tuple[Floats, float]]:
    """Signals (frames, channels + 1) of one unit of what disturbs all channels alike, and its spread."""
    frames, width = seen.values.shape
    for k in range(frames):
        frame = (np.arange(frames) == k)[:, None]
        yield frame * of_force, _FORCE_SD
        yield frame * seen.slope, n.position_mm
    pressure = np.arange(width) < width - 1
    ones, share = np.ones((frames, 1)), np.zeros((frames, 1))
    share[~seen.press, 0] = np.linspace(0, 1, int((~seen.press).sum()))
    zero = n.drift * FULL_SCALE_KPA
    yield ones * pressure, zero
    yield share * pressure, 2 * zero
    yield ones * ~pressure, n.displacement_zero_mm
    yield (2 * share - 1) * ~pressure, n.displacement_drift_mm
    yield seen.slope, _START_SD_MM
    yield seen.slope * seen.x_mm[:, None], n.position_scale
    yield seen.values * pressure, n.common_gain
