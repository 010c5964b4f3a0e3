"""Element integrals, taken once: nine displacement nodes, pressure linear and free in each element.

The energy is W = mu/2 (F:F - 2) - mu (J - 1) + (lambda + mu)/2 (Jbar - 1)^2 with Jbar the projection of
J on {1, x, y} in each element. J is quadratic in the displacement u, so with

    g_k = integral of N_k grad N_a,    C_k = integral of N_k (N_a,x N_b,y - N_b,x N_a,y)

over the orthonormal N_k of that space, theta_k = g_k . u + ux . C_k uy is exactly the k-th coefficient of
J - 1, and no quadrature is needed afterwards. Units: mm, kPa.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numba import njit
from numpy.typing import NDArray
from skfem import ElementQuad2
from skfem.quadrature import get_quadrature

from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.lanes import pack
from palpate.sim.tissue.mesh import ALONG_THEN_UP, TissueMesh

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ElementIntegrals:
    """Integrals of every element, for unit stiffness.

    Attributes
    ----------
    g : ndarray (M, 2, 3, 9)
        Integral of N_k dN_a/dx and N_k dN_a/dy.
    C : ndarray (M, 3, 9, 9)
        Antisymmetric; see the module's text.
    L : ndarray (M, 9, 9)
        Integral of grad N_a . grad N_b.
    C0 : ndarray (M, 9, 9)
        Minus the integral of N_a,x N_b,y - N_b,x N_a,y.
    dN : ndarray (M, 9, 2, 9)
        Gradients of the shape functions at the nine Gauss points.
    dx : ndarray (M, 9)
        The Gauss points' areas.
    packed : ndarray (groups, 459, 8)
        g, C, L and C0 once more, for eight elements at once (`lanes.pack`).
    """

    g: Floats
    C: Floats
    L: Floats
    C0: Floats
    dN: Floats
    dx: Floats
    packed: Floats


QUADRATURE: tuple[Floats, Floats] = get_quadrature(ElementQuad2, 5)
"""Three by three Gauss points (2, 9) and their weights (9,), on the unit square."""


@cache
def reference_element() -> tuple[Floats, Floats, Floats]:
    """Values (9 points, 9 nodes) and gradients (9, 2, 9) of `ElementQuad2`, and the points' weights (9,)."""
    points, weights = QUADRATURE
    functions = [ElementQuad2().lbasis(points, i) for i in ALONG_THEN_UP]
    values, gradients = np.stack([N for N, _ in functions], -1), np.stack([dN for _, dN in functions], -1)
    return values, np.ascontiguousarray(gradients.transpose(1, 0, 2)), weights


def integrate(mesh: TissueMesh) -> ElementIntegrals:
    """Integrals of all elements of `mesh`.

    Raises
    ------
    CaseError
        An element is folded over (its Jacobian is not positive).
    """
    values, gradients, weights = reference_element()
    M = len(mesh.elements)
    g, C = np.empty((M, 2, 3, 9)), np.empty((M, 3, 9, 9))
    L, C0 = np.empty((M, 9, 9)), np.empty((M, 9, 9))
    dN, dx = np.empty((M, 9, 2, 9)), np.empty((M, 9))
    if not _integrate(mesh.nodes_mm[mesh.elements], values, gradients, weights, g, C, L, C0, dN, dx):
        raise CaseError("an element of the mesh is folded over; give another --hx")
    return ElementIntegrals(g, C, L, C0, dN, dx, pack(g, C, L, C0))


@njit(cache=True, nogil=True)
def _integrate(X, values, gradients, weights, g, C, L, C0, dN, dx):  # type: ignore[no-untyped-def]
    good = True
    Nk = np.empty((9, 3))
    twist = np.empty(9)
    for e in range(X.shape[0]):
        cx = X[e, :, 0].mean()
        cy = X[e, :, 1].mean()
        for q in range(9):
            a = b = c = d = x = y = 0.0
            for n in range(9):
                a += gradients[q, 0, n] * X[e, n, 0]
                b += gradients[q, 0, n] * X[e, n, 1]
                c += gradients[q, 1, n] * X[e, n, 0]
                d += gradients[q, 1, n] * X[e, n, 1]
                x += values[q, n] * X[e, n, 0]
                y += values[q, n] * X[e, n, 1]
            det = a * d - b * c
            if det <= 0.0:
                good = False
            a, b, c, d = a / det, b / det, c / det, d / det
            for n in range(9):
                dN[e, q, 0, n] = d * gradients[q, 0, n] - b * gradients[q, 1, n]
                dN[e, q, 1, n] = a * gradients[q, 1, n] - c * gradients[q, 0, n]
            dx[e, q] = weights[q] * det
            Nk[q, 0] = 1.0
            Nk[q, 1] = x - cx
            Nk[q, 2] = y - cy
        for k in range(3):  # Gram-Schmidt in the element's own inner product
            for j in range(k):
                s = 0.0
                for q in range(9):
                    s += Nk[q, k] * Nk[q, j] * dx[e, q]
                for q in range(9):
                    Nk[q, k] -= s * Nk[q, j]
            s = 0.0
            for q in range(9):
                s += Nk[q, k] ** 2 * dx[e, q]
            for q in range(9):
                Nk[q, k] /= np.sqrt(s)
        area = 0.0
        for q in range(9):
            area += dx[e, q]
        gx = g[e, 0]
        gy = g[e, 1]
        gx[:] = 0.0
        gy[:] = 0.0
        C[e] = 0.0
        L[e] = 0.0
        for q in range(9):
            x = dN[e, q, 0]
            y = dN[e, q, 1]
            w = dx[e, q]
            for k in range(3):
                Nw = Nk[q, k] * w
                for n in range(9):
                    gx[k, n] += Nw * x[n]
                    gy[k, n] += Nw * y[n]
            for m in range(9):
                mx = x[m] * w
                my = y[m] * w
                row = L[e, m]
                for n in range(9):
                    row[n] += mx * x[n] + my * y[n]
                    twist[n] = mx * y[n] - my * x[n]
                for k in range(3):
                    row = C[e, k, m]
                    Nq = Nk[q, k]
                    for n in range(9):
                        row[n] += Nq * twist[n]
        root = np.sqrt(area)  # N_0 is 1 / root everywhere
        for m in range(9):
            for n in range(9):
                C0[e, m, n] = -root * C[e, 0, m, n]
    return good
