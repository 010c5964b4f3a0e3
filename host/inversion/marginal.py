"""How an unknown's posterior falls off on either side of a mode, where forward models are cheap.

The unknown is held at one value after another and all others follow to the likeliest: its profile. How well
they are known there weighs it (L. Tierney, J. Kadane, JASA 81, 1986).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from palpate.inversion.forward import Emulates, Predicts
from palpate.inversion.found import Found
from palpate.inversion.joint import Together
from palpate.inversion.search import Mode, Sides, search
from palpate.inversion.valley import TAILS, Valley
from palpate.inversion.widening import NORMAL
from palpate.sim.tissue import CaseError, StrokeError

Floats = NDArray[np.float64]

_TOLD = "ln d", "ln depth", "ln t", "E^-2/3"
_STEP, _LONGER, _FLAT = 1.0, 1.5, 0.6
"""Of Laplace's standard deviations; so much longer where the logarithm has fallen by less than the last."""
_MOST, _GONE = 8, 3.5
"""So many steps to a side, at most: until the logarithm has fallen so far."""
_LEAST_STEP = 1e-6
"""Of Laplace's: two slices nearer each other than this are one, where a range ends."""
_STEPS, _ENOUGH, _DAMPING = 4, 0.2, 1e-3
_ERRS, _AFAR = 4.0, 1.5
"""So much of the logarithm an emulator's errors take, from so far on of the guesses that were computed."""
_FINE = 801
_LEAST = 0.5
"""Of Laplace's: a profile is ragged where a search ends beside another mode."""


def with_sides(found: Found) -> Found:
    """The mode with standard deviations below and above it of what is told, where the class has it."""
    names = [unknown.name for unknown in found.posterior.of.unknowns]
    at = {name: names.index(name) for name in _TOLD if name in names}
    at["ln_E"] = found.posterior.at["ln_E"].start
    sides = {name: _sides(found, number) for name, number in at.items()}
    return replace(found, mode=replace(found.mode, sides=sides))


def _sides(found: Found, at: int) -> Sides:
    values, logs = _profile(found, at)
    x = np.linspace(values[0], values[-1], _FINE)
    density = np.exp(PchipInterpolator(values, logs - logs.max())(x))
    below = np.append(0.0, np.cumsum(density[1:] + density[:-1]))
    low, _, high = np.interp(TAILS, below / below[-1], x)
    mode, least = float(found.mode.z[at]), _LEAST * float(np.sqrt(found.mode.covariance[at, at]))
    return Sides(max((mode - float(low)) / NORMAL, least), max((float(high) - mode) / NORMAL, least))


def valley_along(posterior: Together, forward: Predicts, mode: Mode, at: int) -> Valley:
    """The posterior cut into slices where the unknown number `at` is held."""
    slices = slices_through(posterior, forward, mode, at)
    return Valley(
        np.array([one.mode.z[at] for one in slices]),
        np.array([one.log for one in slices]),
        np.array([one.mode.z for one in slices]),
        np.array([one.mode.covariance for one in slices]),
    )


def _profile(found: Found, at: int) -> tuple[Floats, Floats]:
    """Values (n,) of an unknown, ascending, and the logarithms of its density there."""
    forward = found.forward
    assert isinstance(forward, Emulates)
    away_of = forward.away

    def told_less(mode: Mode) -> float:
        away = away_of(mode.z[found.posterior.at["tissue"]])
        return mode.log_evidence + _ERRS * min(away / _AFAR, 1.0)

    slices = slices_through(found.posterior, forward, found.mode, at, told_less)
    return np.array([one.mode.z[at] for one in slices]), np.array([one.log for one in slices])


class Slice(NamedTuple):
    """The likeliest guess with one unknown as it is, and the logarithm of its density."""

    mode: Mode
    log: float


def slices_through(
    posterior: Together,
    forward: Predicts,
    mode: Mode,
    at: int,
    log: Callable[[Mode], float] = lambda mode: mode.log_evidence,
) -> list[Slice]:
    """Slices at values of the unknown number `at`, ascending: the mode's, and on either side of it."""

    def held(z: Floats) -> Slice:
        one = search(posterior, forward, z, _STEPS, enough=_ENOUGH, damping=_DAMPING, held=at)
        return Slice(one, log(one))

    out = [held(mode.z)]
    sd = float(np.sqrt(mode.covariance[at, at]))
    for side in (sd, -sd):
        z, last, step = mode.z, out[0].log, _STEP
        way = side * mode.covariance[:, at] / mode.covariance[at, at]
        for _ in range(_MOST):
            guess = posterior.within(z + step * way)
            if abs(guess[at] - z[at]) < _LEAST_STEP * sd:
                break
            try:
                one = held(guess)
            except (CaseError, StrokeError):
                break
            out.append(one)
            if one.log < max(each.log for each in out) - _GONE:
                break
            way, z = (one.mode.z - z) / step, one.mode.z
            step *= _LONGER if one.log > last - _FLAT else 1.0
            last = one.log
    return sorted(out, key=lambda one: float(one.mode.z[at]))
