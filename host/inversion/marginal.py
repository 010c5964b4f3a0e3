"""How an unknown's posterior falls off on either side of a mode, where forward models are cheap.

The unknown is held at one value after another and all others follow to the likeliest: its profile. How well
they are known there weighs it (L. Tierney, J. Kadane, JASA 81, 1986).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from palpate.inversion.forward import Emulates
from palpate.inversion.found import Found
from palpate.inversion.search import Sides, search
from palpate.inversion.widening import NORMAL
from palpate.sim.tissue import CaseError, StrokeError

Floats = NDArray[np.float64]

_TOLD = "ln d", "ln depth", "ln t", "E^-2/3"
_STEP, _LONGER, _FLAT = 1.0, 1.5, 0.6
"""Of Laplace's standard deviations; so much longer where the logarithm has fallen by less than the last."""
_MOST, _GONE = 8, 3.5
"""So many steps to a side, at most: until the logarithm has fallen so far."""
_STEPS, _ENOUGH, _DAMPING = 4, 0.2, 1e-3
_ERRS, _AFAR = 4.0, 1.5
"""So much of the logarithm an emulator's errors take, from so far on of the guesses that were computed."""
_FINE = 801
_TAIL = 0.05
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
    low, high = np.interp([_TAIL, 1 - _TAIL], below / below[-1], x)
    mode, least = float(found.mode.z[at]), _LEAST * float(np.sqrt(found.mode.covariance[at, at]))
    return Sides(max((mode - float(low)) / NORMAL, least), max((float(high) - mode) / NORMAL, least))


def _profile(found: Found, at: int) -> tuple[Floats, Floats]:
    """Values (n,) of an unknown, ascending, and the logarithms of its density there."""
    mode = found.mode
    _, log = _held(found, at, mode.z)
    points = {float(mode.z[at]): log}
    sd = float(np.sqrt(mode.covariance[at, at]))
    for side in (sd, -sd):
        z, last, step = mode.z, log, _STEP
        way = side * mode.covariance[:, at] / mode.covariance[at, at]
        for _ in range(_MOST):
            guess = found.posterior.within(z + step * way)
            if guess[at] == z[at]:
                break
            try:
                there, its = _held(found, at, guess)
            except (CaseError, StrokeError):
                break
            points[float(there[at])] = its
            if its < max(points.values()) - _GONE:
                break
            way, z = (there - z) / step, there
            step *= _LONGER if its > last - _FLAT else 1.0
            last = its
    values = np.array(sorted(points))
    return values, np.array([points[value] for value in values.tolist()])


def _held(found: Found, at: int, z: Floats) -> tuple[Floats, float]:
    """The likeliest guess with one unknown as it is, and the logarithm of its density."""
    forward = found.forward
    assert isinstance(forward, Emulates)
    mode = search(found.posterior, forward, z, _STEPS, enough=_ENOUGH, damping=_DAMPING, held=at)
    away = forward.away(mode.z[found.posterior.at["tissue"]])
    return mode.z, mode.log_evidence + _ERRS * min(away / _AFAR, 1.0)
