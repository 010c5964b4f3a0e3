"""The bound of a stroke over a lump anywhere in plane strain: derivatives from strokes computed for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.learn.data import sweep_progress
from palpate.learn.observed import noise_named
from palpate.progress import ProgressCallback
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue import Case, Stroke, iterate_strokes, sweep
from palpate.sim.tissue.any_tissue import PRESSES, STROKES
from tests.studies.bound import Bound, Felt, bound

FINE_STROKES = replace(STROKES, hx_mm=1.0)
FINE_PRESSES = replace(PRESSES, hx_mm=1.0)
FRAMES, TRAVEL_MM, COLUMNS = 50, 80.0, 26
PRESS_SHARES = (0.25, 0.5)
_STEP = 0.05


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
    sweep(presses, FINE_PRESSES, directory / "press", workers=workers, progress=report)
    sweep(wanted, FINE_STROKES, directory / "strokes", workers=workers, progress=report)
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
    from scipy.interpolate import CubicSpline

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
