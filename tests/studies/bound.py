"""What a stroke itself tells of a lump: a bound, by Fisher's information.

Every channel of every frame of a stroke and of the press before it counts, whatever features an estimate may
be made of; a channel is a cell, or a row of cells that read alike. What else is not known (tissue, face, the
hand's force and place in every frame, gains, zeros) is estimated too, with what is known of it beforehand.
The channels' own gains and zeros enter as a covariance, inverted by Woodbury's formula. No unbiased estimate,
and no posterior in a nearly linear world, is narrower. Derivatives come from strokes computed for them,
in plane strain. Units: mm, kPa.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from palpate.features.map_features import Floats
from palpate.learn.data import sweep_progress
from palpate.learn.observed import noise_named
from palpate.progress import ProgressCallback
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue import Case, Stroke, iterate_strokes, sweep
from palpate.sim.tissue.any_tissue import PRESSES, STROKES
from palpate.wire.cells import FULL_SCALE_KPA

MEDIAN_OF_SD = 0.6745
"""Median of a normal error over its standard deviation."""

PRESS_FRAMES = 4
"""Frames near each of the forces at which the press is looked at."""

_FORCE_SD = 0.05
"""Of a force that wanders by 10 % at most."""
_START_SD_MM = 3.0

FRAMES, TRAVEL_MM, COLUMNS = 50, 80.0, 26
PRESS_SHARES = (0.25, 0.5)
_STEP = 0.05


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


@dataclass(frozen=True)
class Parameter:
    """One thing not known: how to change a case, by how much, and its spread over the design."""

    name: str
    step: float
    prior: float
    value: Callable[[Case], float]
    at: Callable[[Case, float], Case]


def _log(field: str, prior: float, step: float = _STEP) -> Parameter:
    def at(case: Case, value: float) -> Case:
        changed: dict[str, Any] = {field: float(np.exp(value))}
        return replace(case, **changed)

    return Parameter(f"ln {field}", step, prior, lambda c: float(np.log(getattr(c, field))), at)


PARAMETERS = (
    Parameter("ln d", _STEP, 0.40, lambda c: float(np.log(c.d_mm)),
              lambda c, v: replace(c, d_mm=float(np.exp(v)), h=c.depth_mm / float(np.exp(v)))),
    Parameter("ln depth", _STEP, 0.78, lambda c: float(np.log(c.depth_mm)),
              lambda c, v: replace(c, h=float(np.exp(v)) / c.d_mm)),
    _log("fat_mm", 0.58),
    Parameter("E^-2/3", 0.03, 0.18, lambda c: c.E_inv23,
              lambda c, v: replace(c, E_ratio=max(v, 0.003) ** -1.5)),
    _log("gland_ratio", 0.46),
    _log("gland_mm", 0.38),
    Parameter("b of the fat", 0.4, 0.87, lambda c: c.fat_stiffening,
              lambda c, v: replace(c, fat_stiffening=max(v, 0.0))),
    Parameter("b of the gland", 0.4, 0.87, lambda c: c.gland_stiffening,
              lambda c, v: replace(c, gland_stiffening=max(v, 0.0))),
    _log("probe_radius_mm", 0.029, 0.03),
)  # fmt: skip
_PRIORS = (*(p.prior for p in PARAMETERS), 0.37, 0.46)


def neighbours(case: Case) -> list[Case]:
    """The case, at a little less and more force, and with each parameter a little less and more."""
    out = [case, *(replace(case, F_rel=case.F_rel * np.exp(sign * 2 * _STEP)) for sign in (-1, 1))]
    for p in PARAMETERS:
        out += [p.at(case, p.value(case) + sign * p.step) for sign in (-1, 1)]
    return out


def simulate_neighbours(
    cases: Sequence[Case],
    directory: Path,
    workers: int | None = None,
    progress: ProgressCallback | None = None,
) -> dict[Case, Stroke]:
    """Strokes and presses of all `neighbours` of these cases, by case; what cannot be computed is absent."""
    wanted = [near for case in cases for near in neighbours(case)]
    presses = [replace(c, F_rel=c.F_rel * share) for c in wanted for share in PRESS_SHARES]
    report = sweep_progress("strokes that differ in one thing", progress)
    sweep(presses, PRESSES, directory / "press", workers=workers, progress=report)
    sweep(wanted, STROKES, directory / "strokes", workers=workers, progress=report)
    homes = (directory / "press", directory / "strokes")
    return {stroke.case: stroke for home in homes for stroke in iterate_strokes(home)}


def computed_bound(case: Case, found: dict[Case, Stroke], noise: Noise | str) -> Bound | None:
    """The bound for one stroke; None where one of its neighbours could not be computed."""
    signals = []
    for near in neighbours(case):
        presses = [found.get(replace(near, F_rel=near.F_rel * share)) for share in PRESS_SHARES]
        parts = [found.get(near), *presses]
        if any(part is None for part in parts):
            return None
        signals.append(_felt([part for part in parts if part is not None]))
    seen, less, more = signals[:3]
    derivatives = {}
    for p, low, high in zip(PARAMETERS, signals[3::2], signals[4::2]):
        ends = [p.value(p.at(case, p.value(case) + sign * p.step)) for sign in (-1, 1)]
        derivatives[p.name] = (high.values - low.values) / (ends[1] - ends[0])
    of_force = (more.values - less.values) / (4 * _STEP)
    return bound(seen, derivatives, of_force, _PRIORS, noise_named(noise))


def _felt(parts: Sequence[Stroke]) -> Felt:
    whole = parts[0].full()
    along = CubicSpline(whole.positions_mm, np.column_stack([whole.images_kPa, whole.displacement_mm]))
    x = np.linspace(-TRAVEL_MM / 2, TRAVEL_MM / 2, FRAMES)
    pressed = [np.append(p.images_kPa[0], p.displacement_mm[0]) for p in parts[1:]]
    pressed.append(along(-TRAVEL_MM / 2))
    n = len(pressed)
    return Felt(
        np.concatenate([pressed, along(x)]),
        np.concatenate([np.zeros((n, whole.images_kPa.shape[1] + 1)), along(x, 1)]),
        np.concatenate([np.full(n, -TRAVEL_MM / 2), x]),
        np.arange(n + FRAMES) < n,
        COLUMNS,
    )
