"""Deformation at an element's Gauss points, and what the material makes of it; inlined into `kernels.py`."""

# mypy: ignore-errors
from __future__ import annotations

from numba import njit

from palpate.sim.tissue.law import exponential

LANES = 32


@njit(cache=True, fastmath=True, nogil=True, inline="always")
def deform(u, nodes, dN, F):
    """F = 1 + sum u_a grad N_a."""
    for i in range(3):
        for j in range(3):
            for p in range(LANES):
                F[i, j, p] = 1.0 if i == j else 0.0
    for j in range(3):
        f0 = F[0, j]
        f1 = F[1, j]
        f2 = F[2, j]
        for a in range(27):
            n = 3 * nodes[a]
            x = u[n]
            y = u[n + 1]
            z = u[n + 2]
            d = dN[j, a]
            for p in range(LANES):
                f0[p] += x * d[p]
                f1[p] += y * d[p]
                f2[p] += z * d[p]


@njit(cache=True, fastmath=True, nogil=True, inline="always")
def cofactors(F, C, J):
    """C = J F^-T = dJ/dF, and J - 1."""
    for p in range(LANES):
        a = F[0, 0, p]
        b = F[0, 1, p]
        c = F[0, 2, p]
        d = F[1, 0, p]
        e = F[1, 1, p]
        f = F[1, 2, p]
        g = F[2, 0, p]
        h = F[2, 1, p]
        i = F[2, 2, p]
        C[0, 0, p] = e * i - f * h
        C[0, 1, p] = f * g - d * i
        C[0, 2, p] = d * h - e * g
        C[1, 0, p] = h * c - i * b
        C[1, 1, p] = i * a - g * c
        C[1, 2, p] = g * b - h * a
        C[2, 0, p] = b * f - c * e
        C[2, 1, p] = c * d - a * f
        C[2, 2, p] = a * e - b * d
        J[p] = a * C[0, 0, p] + b * C[0, 1, p] + c * C[0, 2, p] - 1.0


@njit(cache=True, nogil=True, inline="always")
def stiffen(F, J, b, mu_dx, m, dm):
    """m = mu phi' dx and dm = mu phi'' dx of the exponential law, I = F:F - 1 - 2 J."""
    for p in range(LANES):
        I = -3.0 - 2.0 * J[p]
        for i in range(3):
            for j in range(3):
                I += F[i, j, p] * F[i, j, p]
        first, second = exponential(b[p], I)
        dm[p] = second * mu_dx[p]
        m[p] = first * mu_dx[p]
