"""Compiled loops over elements. Shapes and units as in `element.py` and `material.py`."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

_EXPONENT_CAP = 4.0
"""Beyond b I = 4 (e^4 = 55 times stiffer) the exponential law goes on linearly, so nothing overflows."""


@njit(cache=True, fastmath=True, nogil=True)
def residual(u, pressures, frozen, elements, g, C, L, C0, mu, bulk, R, mixed, theta, G, excesses):
    """Add the internal forces of all elements to R (2N,) and those of the mixed method to `mixed` (2N,).

    `frozen` (M, 3, 18) holds the volume gradients G of the tangent that is in use; `theta` (M, 3) is filled
    with the volume change, `G` (M, 3, 18) with its gradients at `u`, `excesses` (M, 3) with what `pressures`
    have more than the volume change says; `mixed` takes these up.
    """
    ux = np.empty(9)
    uy = np.empty(9)
    fx = np.empty(9)
    fy = np.empty(9)
    dx = np.zeros(9)
    dy = np.zeros(9)
    Gx = np.empty(9)
    Gy = np.empty(9)
    for e in range(elements.shape[0]):
        for a in range(9):
            ux[a] = u[2 * elements[e, a]]
            uy[a] = u[2 * elements[e, a] + 1]
            dx[a] = 0.0
            dy[a] = 0.0
        m = mu[e]
        for a in range(9):
            x = 0.0
            y = 0.0
            for b in range(9):
                x += L[e, a, b] * ux[b] + C0[e, a, b] * uy[b]
                y += L[e, a, b] * uy[b] - C0[e, a, b] * ux[b]
            fx[a] = m * x
            fy[a] = m * y
        for k in range(3):
            t = 0.0
            for a in range(9):
                x = g[e, 0, k, a]
                y = g[e, 1, k, a]
                t += y * uy[a]
                for b in range(9):
                    c = C[e, k, a, b]
                    x += c * uy[b]
                    y -= c * ux[b]
                t += x * ux[a]
                Gx[a] = x
                Gy[a] = y
            theta[e, k] = t
            q = bulk[e] * t
            excess = pressures[e, k] - q
            excesses[e, k] = excess
            for a in range(9):
                G[e, k, a] = Gx[a]
                G[e, k, 9 + a] = Gy[a]
            for a in range(9):
                fx[a] += q * Gx[a]
                fy[a] += q * Gy[a]
                dx[a] += excess * (Gx[a] - frozen[e, k, a])
                dy[a] += excess * (Gy[a] - frozen[e, k, 9 + a])
        for a in range(9):
            n = 2 * elements[e, a]
            R[n] += fx[a]
            R[n + 1] += fy[a]
            mixed[n] += dx[a]
            mixed[n + 1] += dy[a]


@njit(cache=True, fastmath={"contract"}, nogil=True)
def mixed(excess, G, frozen, elements, out):
    """Add to `out` (2N,) what the mixed method's forces have more than the true ones, from `residual`.

    The one contraction that is allowed is the one `residual` makes, so that both give the same bits.
    """
    dx = np.empty(9)
    dy = np.empty(9)
    for e in range(elements.shape[0]):
        for a in range(9):
            dx[a] = 0.0
            dy[a] = 0.0
        for k in range(3):
            for a in range(9):
                dx[a] += excess[e, k] * (G[e, k, a] - frozen[e, k, a])
                dy[a] += excess[e, k] * (G[e, k, 9 + a] - frozen[e, k, 9 + a])
        for a in range(9):
            n = 2 * elements[e, a]
            out[n] += dx[a]
            out[n + 1] += dy[a]


@njit(cache=True, fastmath=True, nogil=True)
def tangent(u, pressures, which, elements, g, C, L, C0, mu, bulk, K, frozen):
    """Fill the stiffnesses K (M, 18, 18) and volume gradients (M, 3, 18) of the elements `which`."""
    ux = np.empty(9)
    uy = np.empty(9)
    for e in which:
        for a in range(9):
            ux[a] = u[2 * elements[e, a]]
            uy[a] = u[2 * elements[e, a] + 1]
        G = frozen[e]
        for k in range(3):
            for a in range(9):
                x = g[e, 0, k, a]
                y = g[e, 1, k, a]
                for b in range(9):
                    c = C[e, k, a, b]
                    x += c * uy[b]
                    y -= c * ux[b]
                G[k, a] = x
                G[k, 9 + a] = y
        m = mu[e]
        s = bulk[e]
        q0 = pressures[e, 0]
        q1 = pressures[e, 1]
        q2 = pressures[e, 2]
        for a in range(18):
            x0 = s * G[0, a]
            x1 = s * G[1, a]
            x2 = s * G[2, a]
            for b in range(18):
                K[e, a, b] = x0 * G[0, b] + x1 * G[1, b] + x2 * G[2, b]
        for a in range(9):
            for b in range(9):
                d = m * L[e, a, b]
                K[e, a, b] += d
                K[e, 9 + a, 9 + b] += d
                t = m * C0[e, a, b] + q0 * C[e, 0, a, b] + q1 * C[e, 1, a, b] + q2 * C[e, 2, a, b]
                K[e, a, 9 + b] += t
                K[e, 9 + a, b] -= t


@njit(cache=True, fastmath=True, nogil=True)
def pressure(du, elements, theta, frozen, bulk):
    """Pressure coefficients (M, 3) after the step `du`: bulk (theta + G du) with the tangent's own G."""
    q = np.empty_like(theta)
    for e in range(elements.shape[0]):
        for k in range(3):
            t = theta[e, k]
            for a in range(9):
                n = 2 * elements[e, a]
                t += frozen[e, k, a] * du[n] + frozen[e, k, 9 + a] * du[n + 1]
            q[e, k] = bulk[e] * t
    return q


@njit(cache=True, nogil=True)
def _stiffening(b, I):
    """Factor on mu, and its derivative by I."""
    z = b * I
    if z < _EXPONENT_CAP:
        f = np.exp(z)
        return f, b * f
    f = np.exp(_EXPONENT_CAP)
    return f * (1 + z - _EXPONENT_CAP), b * f


@njit(cache=True, nogil=True)
def stiffening_residual(u, elements, which, dN, dx, mu, b, R):
    """Add the forces of the exponential law's elements `which` to R (2N,)."""
    for e in which:
        nodes = elements[e]
        for p in range(9):
            v1 = 0.0
            v2 = 0.0
            for a in range(9):
                n = 2 * nodes[a]
                v1 += dN[e, p, 0, a] * u[n] - dN[e, p, 1, a] * u[n + 1]
                v2 += dN[e, p, 1, a] * u[n] + dN[e, p, 0, a] * u[n + 1]
            f, _ = _stiffening(b[e], v1 * v1 + v2 * v2)
            f *= mu[e] * dx[e, p]
            for a in range(9):
                n = 2 * nodes[a]
                R[n] += f * (dN[e, p, 0, a] * v1 + dN[e, p, 1, a] * v2)
                R[n + 1] += f * (dN[e, p, 0, a] * v2 - dN[e, p, 1, a] * v1)


@njit(cache=True, fastmath=True, nogil=True)
def stiffening_tangent(u, elements, which, dN, dx, mu, b, K):
    """Add the stiffness of the exponential law's elements `which` to K (M, 18, 18)."""
    w = np.empty(18)
    for e in which:
        nodes = elements[e]
        for p in range(9):
            D = dN[e, p]
            v1 = 0.0
            v2 = 0.0
            for a in range(9):
                n = 2 * nodes[a]
                v1 += D[0, a] * u[n] - D[1, a] * u[n + 1]
                v2 += D[1, a] * u[n] + D[0, a] * u[n + 1]
            f, df = _stiffening(b[e], v1 * v1 + v2 * v2)
            f *= mu[e] * dx[e, p]
            df *= 2 * mu[e] * dx[e, p]
            for a in range(9):
                w[a] = D[0, a] * v1 + D[1, a] * v2
                w[9 + a] = D[0, a] * v2 - D[1, a] * v1
            for a in range(18):
                t = df * w[a]
                for c in range(18):
                    K[e, a, c] += t * w[c]
            for a in range(9):
                for c in range(9):
                    s = f * (D[0, a] * D[0, c] + D[1, a] * D[1, c])
                    t = f * (D[1, a] * D[0, c] - D[0, a] * D[1, c])
                    K[e, a, c] += s
                    K[e, 9 + a, 9 + c] += s
                    K[e, a, 9 + c] += t
                    K[e, 9 + a, c] -= t


@njit(cache=True, nogil=True)
def smallest_jacobian(u, elements, dN):
    """Smallest det F at the Gauss points of all elements."""
    least = np.inf
    for e in range(elements.shape[0]):
        for p in range(9):
            a = 1.0
            b = 0.0
            c = 0.0
            d = 1.0
            for k in range(9):
                n = 2 * elements[e, k]
                a += dN[e, p, 0, k] * u[n]
                b += dN[e, p, 1, k] * u[n]
                c += dN[e, p, 0, k] * u[n + 1]
                d += dN[e, p, 1, k] * u[n + 1]
            least = min(least, a * d - b * c)
    return least
