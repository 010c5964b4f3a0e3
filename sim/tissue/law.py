"""How tissue stiffens with strain: phi of the energy mu/2 phi(I), law by law.

I = F:F - dim - 2 (J - 1), in the plane (l1 - l2)^2 of the principal stretches. In every law b = 0 is phi = I,
linear elasticity at large strain. A law has an energy, for the weak form and pictures, and slopes, which the
kernels inline; tests hold one to the other. Another law is a name in `case.LAWS` and these two functions.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from palpate.sim.tissue.case import LAWS

Floats = NDArray[np.float64]

EXPONENTIAL, OGDEN = range(len(LAWS))
"""The numbers that kernels know them by. Solid lumps take the first: Ogden's law asks for stretches, and I
determines them in the plane only."""

EXPONENT_CAP = 4.0
"""Beyond b I = 4 (e^4 = 55 times stiffer) the exponential law goes on linearly, so nothing overflows."""
OGDEN_CAP = 7.0
"""Beyond a s = 7 (some 78 times stiffer) so does Ogden's."""


@njit(cache=True, nogil=True, inline="always")
def exponential(b, I):
    """phi = (exp(b I) - 1) / b: phi' = exp(b I) and phi'' = b exp(b I). Fung 1967, Wellman 1999."""
    z = b * I
    f = np.exp(min(z, EXPONENT_CAP))
    return f * (1.0 + max(z - EXPONENT_CAP, 0.0)), b * f


@njit(cache=True, nogil=True)
def ogden(b, I):
    """phi = 8 / a^2 (cosh a s - 1) with a = 2 + b and I = (2 sinh s)^2: phi' and phi''.

    Ogden 1972, one term: W = 2 mu / a^2 (l1^a + l2^a + l3^a - 3), in plane strain l1 = exp s = 1 / l2.
    """
    a = 2.0 + b
    s = np.arcsinh(0.5 * np.sqrt(max(I, 0.0)))
    end = OGDEN_CAP / a
    more = 0.0
    if s > end:
        more = I - 4.0 * np.sinh(end) ** 2
        s = end
    if a * s < 1e-3:
        return 1.0 + (a * a - 4.0) * s * s / 6.0, (a * a - 4.0) / 24.0
    twice = np.sinh(2.0 * s)
    first = 2.0 * np.sinh(a * s) / (a * twice)
    second = first * (a / np.tanh(a * s) - 2.0 / np.tanh(2.0 * s)) / (4.0 * twice)
    return first + second * more, second


@njit(cache=True, nogil=True)
def slopes(law, b, I):
    """phi'(I), the factor on mu, and phi''(I) of the law of this number."""
    if law == OGDEN:
        return ogden(b, I)
    return exponential(b, I)


def phi(law: int, I: Floats, b: Floats) -> tuple[Floats, Floats, Floats]:
    """phi and its first two derivatives.

    Parameters
    ----------
    law : int
        Its place in `case.LAWS`.
    I, b : ndarray of one shape
        Measure of shear, and how the tissue stiffens.
    """
    first, second = _each(law, b.ravel(), I.ravel())
    energy = np.where(b > 0, _ENERGIES[law](np.where(b > 0, b, 1.0), I), I)
    return energy, first.reshape(I.shape), second.reshape(I.shape)


@njit(cache=True)
def _each(law, b, I):
    first, second = np.empty_like(I), np.empty_like(I)
    for i in range(len(I)):
        first[i], second[i] = (1.0, 0.0) if b[i] == 0.0 else slopes(law, b[i], I[i])
    return first, second


def _exponential_energy(b: Floats, I: Floats) -> Floats:
    z = np.minimum(b * I, EXPONENT_CAP)
    more = b * I - z
    return (np.expm1(z) + np.exp(z) * (more + more**2 / 2)) / b


def _ogden_energy(b: Floats, I: Floats) -> Floats:
    a = 2 + b
    end = OGDEN_CAP / a
    s = np.minimum(np.arcsinh(np.sqrt(np.maximum(I, 0)) / 2), end)
    more = np.maximum(I - 4 * np.sinh(end) ** 2, 0)
    twice = np.sinh(2 * end)
    first = 2 * np.sinh(OGDEN_CAP) / (a * twice)
    second = first * (a / np.tanh(OGDEN_CAP) - 2 / np.tanh(2 * end)) / (4 * twice)
    return 16 / a**2 * np.sinh(a * s / 2) ** 2 + first * more + second * more**2 / 2


_ENERGIES = (_exponential_energy, _ogden_energy)
