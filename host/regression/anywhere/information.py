"""What the tactile map itself tells of a lump that lies anywhere: a bound, by Fisher's information.

Every row of sensors in every frame of a stroke and of the press before it counts, whatever features an
estimate may be made of. Derivatives come from strokes that differ in one parameter. What else is not known
(tissue, face, the hand's force in every frame, zeros, gains, places) is estimated too, with what is known of
it beforehand. No unbiased estimate, and no posterior in a nearly linear world, is narrower.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.regression.field.data import sweep_progress
from palpate.regression.observed import noise_named
from palpate.regression.progress import ProgressCallback
from palpate.sim.probe.cells import FULL_SCALE_KPA
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue import Case, Stroke, iterate_strokes, sweep
from palpate.sim.tissue.any_tissue import PRESSES, STROKES

FINE_STROKES = replace(STROKES, hx_mm=1.0)
FINE_PRESSES = replace(PRESSES, hx_mm=1.0)
FRAMES, TRAVEL_MM, COLUMNS = 50, 80.0, 26
PRESS_SHARES = (0.25, 0.5)
PRESS_FRAMES = 4
"""Frames near each of the forces at which the press is looked at."""

_FORCE_SD = 0.05
"""Of a force that wanders by 10 % at most."""
_START_SD_MM = 3.0
_STEP = 0.05

Change = Callable[[Case, float], Case]


@dataclass(frozen=True)
class Parameter:
    """One thing not known: how to change a case, by how much, and its spread over the design."""

    name: str
    step: float
    prior: float
    value: Callable[[Case], float]
    at: Change


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
NAMES = (*(p.name for p in PARAMETERS), "ln F", "ln E_fat")
_PRIOR_F, _PRIOR_FAT = 0.37, 0.46
LENGTHS = ("ln d", "ln depth", "ln fat_mm")


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
    sweep(presses, FINE_PRESSES, directory / "press", workers=workers, progress=report)
    sweep(wanted, FINE_STROKES, directory / "strokes", workers=workers, progress=report)
    homes = (directory / "press", directory / "strokes")
    return {stroke.case: stroke for home in homes for stroke in iterate_strokes(home)}


@dataclass(frozen=True)
class Information:
    """`covariance` of `NAMES` where the map, the press and the spread of the design are all that is known."""

    case: Case
    covariance: Floats

    def sd(self, name: str) -> float:
        """Standard deviation of one of `NAMES`."""
        k = NAMES.index(name)
        return float(np.sqrt(self.covariance[k, k]))

    def told(self, name: str) -> Information:
        """The same where this one is known."""
        k = NAMES.index(name)
        c = self.covariance
        return Information(self.case, c - np.outer(c[k], c[k]) / (c[k, k] + 1e-15))

    def combined(self) -> tuple[float, float]:
        """c and the standard deviation of ln d + c E^-2/3, the combination known best."""
        d, e = NAMES.index("ln d"), NAMES.index("E^-2/3")
        cov = self.covariance
        c = -cov[d, e] / cov[e, e]
        return float(c), float(np.sqrt(max(cov[d, d] - cov[d, e] ** 2 / cov[e, e], 0.0)))


def information(case: Case, found: dict[Case, Stroke], noise: Noise | str) -> Information | None:
    """The bound for one stroke; None where one of its neighbours could not be computed."""
    level = noise_named(noise)
    signals = []
    for near in neighbours(case):
        presses = [found.get(replace(near, F_rel=near.F_rel * share)) for share in PRESS_SHARES]
        parts = [found.get(near), *presses]
        if any(part is None for part in parts):
            return None
        signals.append(_signal([part for part in parts if part is not None]))
    seen, less, more = signals[:3]
    of_force = (more.values - less.values) / (4 * _STEP)
    columns = []
    for k, p in enumerate(PARAMETERS):
        low, high = (p.value(p.at(case, p.value(case) + sign * p.step)) for sign in (-1, 1))
        columns.append((signals[4 + 2 * k].values - signals[3 + 2 * k].values) / (high - low))
    of_fat = np.concatenate([seen.values[:, :-1], 0 * seen.values[:, -1:]], 1) - of_force
    columns += [of_force, of_fat]
    priors = [*(p.prior for p in PARAMETERS), _PRIOR_F, _PRIOR_FAT]
    nuisances, spreads = _nuisances(seen, of_force, level)
    weight = seen.weights(level)
    A = np.stack([(c * weight).ravel() for c in [*columns, *nuisances]], 1)
    H = A.T @ A + np.diag(np.array([*priors, *spreads]) ** -2.0)
    covariance: Floats = np.linalg.inv(H).astype(np.float64)
    return Information(case, covariance[: len(NAMES), : len(NAMES)])


@dataclass(frozen=True)
class _Signal:
    """What a stroke and its press feel: pressures of the rows and the displacement, frame by frame.

    values : (frames, 17); slope the same per mm; x, share : (frames); press : (frames), bool
    """

    values: Floats
    slope: Floats
    x: Floats
    share: Floats
    press: NDArray[np.bool_]

    def weights(self, n: Noise) -> Floats:
        """One over the standard deviation of each value, (frames, 17)."""
        white = n.white * FULL_SCALE_KPA / np.sqrt(COLUMNS)
        sd = np.array([white] * (self.values.shape[1] - 1) + [n.displacement_noise_mm])
        return np.where(self.press, np.sqrt(PRESS_FRAMES), 1.0)[:, None] / sd


def _signal(parts: Sequence[Stroke]) -> _Signal:
    from scipy.interpolate import CubicSpline

    whole = parts[0].full()
    felt = CubicSpline(whole.positions_mm, np.column_stack([whole.images_kPa, whole.displacement_mm]))
    x = np.linspace(-TRAVEL_MM / 2, TRAVEL_MM / 2, FRAMES)
    pressed = [np.append(p.images_kPa[0], p.displacement_mm[0]) for p in parts[1:]]
    pressed.append(felt(-TRAVEL_MM / 2))
    n = len(pressed)
    return _Signal(
        np.concatenate([pressed, felt(x)]),
        np.concatenate([np.zeros((n, whole.images_kPa.shape[1] + 1)), felt(x, 1)]),
        np.concatenate([np.full(n, -TRAVEL_MM / 2), x]),
        np.concatenate([np.zeros(n), np.linspace(0, 1, FRAMES)]),
        np.arange(n + FRAMES) < n,
    )


def _nuisances(seen: _Signal, of_force: Floats, n: Noise) -> tuple[list[Floats], list[float]]:
    """Signals (frames, 17) of one unit of each disturbance, and the disturbances' standard deviations."""
    frames, width = seen.values.shape
    pressures = np.arange(width) < width - 1
    out: list[tuple[Floats, float]] = []
    for k in range(frames):
        frame = (np.arange(frames) == k)[:, None]
        out.append((frame * of_force, _FORCE_SD))
        out.append((frame * seen.slope, n.position_mm))
    for row in range(width - 1):
        cell = np.arange(width) == row
        out.append((seen.values * cell, n.gain / np.sqrt(COLUMNS)))
        out.append((np.ones((frames, 1)) * cell, n.offset * FULL_SCALE_KPA / np.sqrt(COLUMNS)))
    ones, share = np.ones((frames, 1)), seen.share[:, None]
    zero = n.drift * FULL_SCALE_KPA
    out += [(ones * pressures, zero), (share * pressures, 2 * zero)]
    out += [(ones * ~pressures, n.displacement_zero_mm)]
    out += [((2 * share - 1) * ~pressures, n.displacement_drift_mm)]
    out += [(seen.slope, _START_SD_MM), (seen.slope * seen.x[:, None], n.position_scale)]
    if n.common_gain:
        out.append((seen.values * pressures, n.common_gain))
    kept = [(signal, spread) for signal, spread in out if spread > 0 and signal.any()]
    return [signal for signal, _ in kept], [spread for _, spread in kept]
