"""Compiled loops over solid elements, on vectors of Gauss points. Shapes and units as in `element.py`.

Displacements are vectors (3N,), x, y and z of each node in turn; an element's 81 numbers run the same way.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

from palpate.sim.tissue.solid.deformation import LANES, cofactors, deform, stiffen


@njit(cache=True, fastmath=True, nogil=True)
def residual(u, q, frozen, elements, shape, dN, Ndx, mu_dx, b, stiffening, bulk, R, theta):
    """Add the mixed method's forces of all elements to R (3N,), and fill theta (M, 4), the volume change.

    P = m (F - C) + sum q_k N_k C with the pressures q (M, 4) given; what the volume change asks for beyond
    them enters by the gradients `frozen` (M, 4, 81) of the tangent in use.
    """
    F = np.zeros((3, 3, LANES))
    C = np.zeros((3, 3, LANES))
    J = np.zeros(LANES)
    m = np.zeros(LANES)
    dm = np.zeros(LANES)
    c = np.zeros(LANES)
    force = np.zeros(81)
    for e in range(elements.shape[0]):
        nodes = elements[e]
        D = dN[shape[e]]
        N = Ndx[shape[e]]
        deform(u, nodes, D, F)
        cofactors(F, C, J)
        for p in range(LANES):
            m[p] = mu_dx[e, p]
        if stiffening[e]:
            stiffen(F, J, b[e], mu_dx[e], m, dm)
        for p in range(LANES):
            c[p] = -m[p]
        for r in range(81):
            force[r] = 0.0
        for k in range(4):
            t = 0.0
            for p in range(LANES):
                t += N[k, p] * J[p]
                c[p] += q[e, k] * N[k, p]
            theta[e, k] = t
            excess = bulk[e] * t - q[e, k]
            for r in range(81):
                force[r] += excess * frozen[e, k, r]
        for i in range(3):
            for j in range(3):
                for p in range(LANES):
                    F[i, j, p] = m[p] * F[i, j, p] + c[p] * C[i, j, p]
        for a in range(27):
            x = 0.0
            y = 0.0
            z = 0.0
            for j in range(3):
                d = D[j, a]
                for p in range(LANES):
                    x += F[0, j, p] * d[p]
                    y += F[1, j, p] * d[p]
                    z += F[2, j, p] * d[p]
            n = 3 * nodes[a]
            R[n] += force[3 * a] + x
            R[n + 1] += force[3 * a + 1] + y
            R[n + 2] += force[3 * a + 2] + z


@njit(cache=True, fastmath=True, nogil=True)
def tangent(u, q, which, elements, shape, dN, Ndx, mu_dx, b, stiffening, bulk, kind, L, K, frozen):
    """Fill the upper triangles of K (n, 81, 81) and the volume gradients `frozen` (M, 4, 81) of `which` (n,).

    K = sum bulk G_k G_k^T + L + geometric, where the last is the integral of c dC/dF with c = q_k N_k - m.
    """
    F = np.zeros((3, 3, LANES))
    C = np.zeros((3, 3, LANES))
    J = np.zeros(LANES)
    m = np.zeros(LANES)
    dm = np.zeros(LANES)
    c = np.zeros(LANES)
    # matrices are multiplied in the precision that K is kept in
    flat = np.zeros((27, 3 * LANES), K.dtype)
    crossed = np.zeros((81, 3 * LANES), K.dtype)
    along = np.zeros((81, LANES), K.dtype)
    scaled = np.zeros((81, LANES), K.dtype)
    for place in range(len(which)):
        e = which[place]
        D = dN[shape[e]]
        N = Ndx[shape[e]]
        G = frozen[e]
        Ke = K[place]
        deform(u, elements[e], D, F)
        cofactors(F, C, J)
        for p in range(LANES):
            m[p] = mu_dx[e, p]
        if stiffening[e]:
            stiffen(F, J, b[e], mu_dx[e], m, dm)
        for p in range(LANES):
            c[p] = -m[p]
        for k in range(4):
            for p in range(LANES):
                c[p] += q[e, k] * N[k, p]
        for a in range(27):
            for j in range(3):
                d = D[j, a]
                for p in range(LANES):
                    flat[a, j * LANES + p] = d[p]
        for a in range(27):
            for i in range(3):
                g0 = 0.0
                g1 = 0.0
                g2 = 0.0
                g3 = 0.0
                for p in range(LANES):
                    s = C[i, 0, p] * D[0, a, p] + C[i, 1, p] * D[1, a, p] + C[i, 2, p] * D[2, a, p]
                    g0 += N[0, p] * s
                    g1 += N[1, p] * s
                    g2 += N[2, p] * s
                    g3 += N[3, p] * s
                G[0, 3 * a + i] = g0
                G[1, 3 * a + i] = g1
                G[2, 3 * a + i] = g2
                G[3, 3 * a + i] = g3
        for r in range(81):
            g0 = bulk[e] * G[0, r]
            g1 = bulk[e] * G[1, r]
            g2 = bulk[e] * G[2, r]
            g3 = bulk[e] * G[3, r]
            for s in range(r, 81):
                Ke[r, s] = g0 * G[0, s] + g1 * G[1, s] + g2 * G[2, s] + g3 * G[3, s]
        if stiffening[e]:
            _add_stiffening(F, C, D, flat, m, dm, along, scaled, crossed, Ke)
        else:
            for a in range(27):
                for d in range(a, 27):
                    s = L[kind[e], a, d]
                    for i in range(3):
                        Ke[3 * a + i, 3 * d + i] += s
        # F_i . (grad N_a x grad N_b) c, i the direction that neither node moves in
        for i in range(3):
            for a in range(27):
                for p in range(LANES):
                    x = c[p] * F[i, 0, p]
                    y = c[p] * F[i, 1, p]
                    z = c[p] * F[i, 2, p]
                    crossed[27 * i + a, p] = y * D[2, a, p] - z * D[1, a, p]
                    crossed[27 * i + a, LANES + p] = z * D[0, a, p] - x * D[2, a, p]
                    crossed[27 * i + a, 2 * LANES + p] = x * D[1, a, p] - y * D[0, a, p]
        V = np.dot(crossed, flat.T)
        for a in range(27):
            for d in range(a, 27):
                x = V[a, d]
                y = V[27 + a, d]
                z = V[54 + a, d]
                Ke[3 * a, 3 * d + 1] += z
                Ke[3 * a + 1, 3 * d + 2] += x
                if d > a:
                    Ke[3 * a + 2, 3 * d] += y
                    Ke[3 * a + 1, 3 * d] -= z
                    Ke[3 * a + 2, 3 * d + 1] -= x
                Ke[3 * a, 3 * d + 2] -= y


@njit(cache=True, fastmath=True, nogil=True)
def _add_stiffening(F, C, D, flat, m, dm, along, scaled, crossed, Ke):
    """Add m grad N_a . grad N_b and the rank-one part 2 dm (F - C) x (F - C) of the exponential law to Ke."""
    for a in range(27):
        for j in range(3):
            for p in range(LANES):
                crossed[a, j * LANES + p] = m[p] * flat[a, j * LANES + p]
        for i in range(3):
            for p in range(LANES):
                s = 0.0
                for j in range(3):
                    s += (F[i, j, p] - C[i, j, p]) * D[j, a, p]
                along[3 * a + i, p] = s
                scaled[3 * a + i, p] = 2.0 * dm[p] * s
    stiff = np.dot(crossed[:27], flat.T)
    outer = np.dot(scaled, along.T)
    for r in range(81):
        for s in range(r, 81):
            Ke[r, s] += outer[r, s]
    for a in range(27):
        for d in range(a, 27):
            for i in range(3):
                Ke[3 * a + i, 3 * d + i] += stiff[a, d]


@njit(cache=True, fastmath=True, nogil=True)
def pressure(du, elements, theta, frozen, bulk):
    """Pressure coefficients (M, 4) after the step `du`: bulk (theta + G du) with the tangent's own G."""
    q = np.empty_like(theta)
    for e in range(elements.shape[0]):
        for k in range(4):
            t = theta[e, k]
            for a in range(27):
                n = 3 * elements[e, a]
                for i in range(3):
                    t += frozen[e, k, 3 * a + i] * du[n + i]
            q[e, k] = bulk[e] * t
    return q


@njit(cache=True, fastmath=True, nogil=True)
def smallest_jacobian(u, elements, shape, dN):
    """Smallest det F at the Gauss points of all elements."""
    least = np.inf
    F = np.zeros((3, 3, LANES))
    C = np.zeros((3, 3, LANES))
    J = np.zeros(LANES)
    for e in range(elements.shape[0]):
        deform(u, elements[e], dN[shape[e]], F)
        cofactors(F, C, J)
        for p in range(LANES):
            least = min(least, J[p] + 1.0)
    return least
