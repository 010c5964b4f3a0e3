"""A rigid punch on a layer that is bonded to a rigid base: the exact answer of linear elasticity.

Hayes, Keer, Herrmann and Mockros (1972), also Lebedev and Ufliand (1958). The pressure's Hankel transform is
the integral of phi(t) cos(xi t) from 0 to the contact radius; phi solves a Fredholm equation of the second
kind. Lengths in the layer's thickness, pressures in E / (1 - nu^2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Floats = NDArray[np.float64]

_POINTS, _WAVES, _HIGHEST = 40, 400, 25.0


@dataclass(frozen=True)
class Pressed:
    """Force, displacement, and phi (n,) at places t (n,) with weights (n,)."""

    force: float
    displacement: float
    a: float
    t: Floats
    weights: Floats
    phi: Floats

    def middle_pressure(self) -> float:
        """-integral of phi'(t) / t, for a smooth punch: phi is even and vanishes at the edge."""
        fit = np.polynomial.Polynomial.fit(self.t**2, self.phi, 8)
        return float(-(self.weights * 2 * fit.deriv()(self.t**2)).sum())


def compliance(wave: Floats, nu: float) -> Floats:
    """Surface displacement under a pressure of this wave number, over that of a layer without end."""
    kappa, sinh, cosh = 3 - 4 * nu, np.sinh(2 * wave), np.cosh(2 * wave)
    return np.asarray((2 * kappa * sinh - 4 * wave) / (2 * kappa * cosh + 1 + kappa**2 + 4 * wave**2))


def _solve(a: float, nu: float, wanted: Floats, t: Floats, weights: Floats) -> Floats:
    points, share = np.polynomial.legendre.leggauss(_WAVES)
    wave, share = _HIGHEST * (points + 1) / 2, _HIGHEST * share / 2
    waves = np.cos(np.outer(t, wave))
    kernel = (waves * (share * (1 - compliance(wave, nu)))) @ waves.T
    system = np.eye(len(t)) - 2 / np.pi * kernel * weights
    return np.asarray(np.linalg.solve(system, wanted / np.pi))


def _places(a: float) -> tuple[Floats, Floats]:
    points, share = np.polynomial.legendre.leggauss(_POINTS)
    return a * (points + 1) / 2, a * share / 2


def flat_punch(a: float, nu: float) -> float:
    """Force over that on a half space, Hayes' kappa, of a flat punch of radius `a`."""
    t, weights = _places(a)
    phi = _solve(a, nu, np.ones_like(t), t, weights)
    return float(np.pi * (weights * phi).sum() / a)


def sphere(a: float, nu: float, radius: float) -> Pressed:
    """A paraboloid whose contact has the radius `a`."""
    t, weights = _places(a)
    edge = np.append(t, a)  # the last place carries no weight: phi must vanish there
    of_edge = np.append(weights, 0.0)
    flat, bowl = (_solve(a, nu, wanted, edge, of_edge) for wanted in (np.ones_like(edge), edge**2 / radius))
    displacement = bowl[-1] / flat[-1]
    phi = (displacement * flat - bowl)[:-1]
    return Pressed(float(2 * np.pi * (weights * phi).sum()), float(displacement), a, t, weights, phi)


def sphere_at(displacement: float, nu: float, radius: float) -> Pressed:
    """A paraboloid pressed so deep."""
    a = brentq(lambda a: sphere(a, nu, radius).displacement - displacement, 1e-3, 4.0)
    return sphere(float(a), nu, radius)
