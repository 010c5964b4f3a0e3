"""Compiled loops over elements. Shapes and units as in `element.py` and `material.py`.

They compute what `forms.py` defines, as it comes out in the plane with the integrals of `element.py`:

    theta_k = g_k . u + ux . C_k uy        G_k = d theta_k / du = (gx_k + C_k uy, gy_k - C_k ux)
    R       = mu (L ux + C0 uy, L uy - C0 ux) + sum_k k theta_k G_k

with k = lambda' + mu; tests/sim/tissue/test_reference.py holds them to the forms.
"""

# mypy: ignore-errors
from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
from numba import njit

from palpate.sim.tissue import law as laws
from palpate.sim.tissue.lanes import (
    LANES,
    POINTS,
    ROWS,
    UPPER,
    add_eight_forces,
    add_eight_stiffnesses,
    eight_elements,
    eight_shears,
    fma,
)
from palpate.sim.tissue.law import slopes


@njit(cache=True, nogil=True)
def residual(u, pressures, frozen, elements, packed, mu, bulk, R, mixed, theta, G, excesses):
    """Add the internal forces of all elements to R (2N,) and those of the mixed method to `mixed` (2N,).

        R     += mu (L ux + C0 uy, L uy - C0 ux) + sum_k k theta_k G_k
        mixed += sum_k (q_k - k theta_k) (G_k - Gs_k)

    `packed` are the integrals as `lanes.pack` gives them, `frozen` (M, 3, 18) the volume gradients of the
    tangent that is in use; `theta` (M, 3) is filled with the volume change, `G` (M, 3, 18) with its gradients
    at `u`, `excesses` (M, 3) with what `pressures` have more than the volume change says; `mixed` takes these
    up.
    """
    count = elements.shape[0]
    local = np.zeros((18, LANES))
    mus = np.zeros(LANES)
    bulks = np.zeros(LANES)
    given = np.zeros((3, LANES))
    forces = np.empty((18, LANES))
    gradients = np.empty((54, LANES))
    changes = np.empty((3, LANES))
    rest = np.empty((3, LANES))
    for group in range(packed.shape[0]):
        first = LANES * group
        here = min(LANES, count - first)
        for i in range(here):
            e = first + i
            mus[i] = mu[e]
            bulks[i] = bulk[e]
            for k in range(3):
                given[k, i] = pressures[e, k]
            for a in range(9):
                n = 2 * elements[e, a]
                local[a, i] = u[n]
                local[9 + a, i] = u[n + 1]
        eight_elements(
            packed.ctypes.data + 8 * ROWS * LANES * group,
            local.ctypes.data, mus.ctypes.data, bulks.ctypes.data, given.ctypes.data, forces.ctypes.data,
            gradients.ctypes.data, changes.ctypes.data, rest.ctypes.data,
        )  # fmt: skip
        for i in range(here):
            e = first + i
            now = G[e]
            for k in range(3):
                theta[e, k] = changes[k, i]
                excesses[e, k] = rest[k, i]
                for a in range(18):
                    now[k, a] = gradients[18 * k + a, i]
            for a in range(9):
                n = 2 * elements[e, a]
                R[n] += forces[a, i]
                R[n + 1] += forces[9 + a, i]
            _add_excess(excesses[e], now, frozen[e], elements[e], mixed)


@njit(cache=True, nogil=True, inline="always")
def _add_excess(excess, G, frozen, nodes, out):
    """Add sum_k excess_k (G_k - Gs_k) of one element to `out` (2N,): the mixed forces less the true."""
    p = excess[0]
    q = excess[1]
    r = excess[2]
    for a in range(9):
        x = p * (G[0, a] - frozen[0, a])
        y = p * (G[0, 9 + a] - frozen[0, 9 + a])
        x = fma(q, G[1, a] - frozen[1, a], x)
        y = fma(q, G[1, 9 + a] - frozen[1, 9 + a], y)
        out[2 * nodes[a]] += fma(r, G[2, a] - frozen[2, a], x)
        out[2 * nodes[a] + 1] += fma(r, G[2, 9 + a] - frozen[2, 9 + a], y)


@njit(cache=True, nogil=True)
def mixed(excess, G, frozen, elements, out):
    """Add to `out` (2N,) what the mixed method's forces have more than the true ones, from `residual`."""
    for e in range(elements.shape[0]):
        _add_excess(excess[e], G[e], frozen[e], elements[e], out)


@njit(cache=True, fastmath=True, nogil=True)
def tangent(u, pressures, which, elements, g, C, L, C0, mu, bulk, K, frozen):
    """Fill the stiffnesses K (M, 18, 18) and volume gradients (M, 3, 18) of the elements `which`.

    K = k G^T G + [[mu L, T], [-T, mu L]],   T = mu C0 + sum_k q_k C_k
    """
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
    """Pressure coefficients (M, 3) after the step `du`: q = k (theta + Gs du), Gs being the tangent's own."""
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
def stiffening_residual(u, elements, points, mu, law, b, R):
    """Add the forces of elements (n, 9) that stiffen to R (2N,); `points` are theirs, of `lanes.pack_points`.

    R += integral of mu phi'(I) (F - cof F) : grad v,   F - cof F = [[v1, v2], [v2, -v1]],
    v1 = u_x,x - u_y,y,   v2 = u_x,y + u_y,x,   I = v1^2 + v2^2
    """
    local, mus, bs = np.zeros((18, LANES)), np.zeros(LANES), np.zeros(LANES)
    shears, factors, forces = np.empty((2, LANES)), np.empty((2, LANES)), np.empty((18, LANES))
    for group in range(len(points)):
        here = _gather(u, elements, group, mu, b, local, mus, bs)
        forces[:] = 0.0
        for p in range(POINTS):
            point = points[group, p]
            _stretch(point, local, law, mus, bs, shears, factors)
            add_eight_forces(point.ctypes.data, shears.ctypes.data, factors.ctypes.data, forces.ctypes.data)
        for i in range(here):
            nodes = elements[LANES * group + i]
            for a in range(9):
                R[2 * nodes[a]] += forces[a, i]
                R[2 * nodes[a] + 1] += forces[9 + a, i]


@njit(cache=True, nogil=True)
def stiffening_tangent(u, elements, which, numbers, points, mu, law, b, K):
    """Add the stiffness of some of the elements (n, 9) that stiffen to K (M, 18, 18).

    `which` of them, ascending, and their `numbers` (n,) in K; all else as in `stiffening_residual`.

    K += integral of 2 mu phi'' w w^T + mu phi' (dv1^T dv1 + dv2^T dv2),   w = v1 dv1 + v2 dv2
    """
    local, mus, bs = np.zeros((18, LANES)), np.zeros(LANES), np.zeros(LANES)
    shears, factors, upper = np.empty((2, LANES)), np.empty((2, LANES)), np.empty((UPPER, LANES))
    done = 0
    while done < len(which):
        group = which[done] // LANES
        _gather(u, elements, group, mu, b, local, mus, bs)
        upper[:] = 0.0
        for p in range(POINTS):
            point = points[group, p]
            _stretch(point, local, law, mus, bs, shears, factors)
            add_eight_stiffnesses(
                point.ctypes.data, shears.ctypes.data, factors.ctypes.data, upper.ctypes.data
            )
        while done < len(which) and which[done] // LANES == group:
            own, lane, row = K[numbers[which[done]]], which[done] % LANES, 0
            for a in range(18):
                own[a, a] += upper[row, lane]
                row += 1
                for c in range(a + 1, 18):
                    own[a, c] += upper[row, lane]
                    own[c, a] += upper[row, lane]
                    row += 1
            done += 1


@njit(cache=True, nogil=True, inline="always")
def _gather(u, elements, group, mu, b, local, mus, bs):
    """Displacements, moduli and b of a group's elements, and how many there are."""
    here = min(LANES, len(elements) - LANES * group)
    for i in range(here):
        e = LANES * group + i
        mus[i] = mu[e]
        bs[i] = b[e]
        for a in range(9):
            n = 2 * elements[e, a]
            local[a, i] = u[n]
            local[9 + a, i] = u[n + 1]
    return here


@njit(cache=True, nogil=True, inline="always")
def _stretch(point, local, law, mus, bs, shears, factors):
    """Shears (2, 8) of a group's elements at a Gauss point; mu phi' and 2 mu phi'' times its area."""
    eight_shears(point.ctypes.data, local.ctypes.data, shears.ctypes.data)
    for i in range(LANES):
        first, second = slopes(law, bs[i], shears[0, i] ** 2 + shears[1, i] ** 2)
        share = mus[i] * point[18, i]
        factors[0, i] = share * first
        factors[1, i] = 2 * share * second


@njit(cache=True, nogil=True)
def smallest_jacobian(u, elements, dN):
    """Smallest det F at the Gauss points of all elements; F = 1 + grad u."""
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


def renew(inlined, *functions):
    """Compile functions anew whose kept machine code is older than the file `inlined`, which they call.

    Numba looks only at the file that a function stands in: strokes would go on by the old law, silently.
    """
    changed = Path(inlined).stat().st_mtime
    for function in functions:
        kept = f"*.{function.__name__}-{function.py_func.__code__.co_firstlineno}.*.nbi"
        with suppress(OSError):
            for index in Path(function.stats.cache_path or "").glob(kept):
                if index.stat().st_mtime < changed:
                    index.unlink()


renew(laws.__file__, stiffening_residual, stiffening_tangent)
