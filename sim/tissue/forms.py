"""The weak form, once: what the compiled kernels compute and the reference stroke assembles.

Large strain, in the plane (F33 = 1) and in space alike; dim is the mesh's dimension. Displacement u, pressure
q (linear and free in each element), multiplier lambda >= 0 on the surface and the probe's height Y make

    L =   integral over the body of      mu/2 phi(I) + q (J - 1) - q^2 / (2 k)
        + integral over the surface of   lambda gap
        + P Y

stationary, with

    F = 1 + grad u,   J = det F,   I = F:F - dim - 2 (J - 1),   gap = y + u_y - Y - f(x + u_x - X)

phi(I), which is I where b = 0, stands in `law.py`; k = lambda' + mu of Lame's constants; P is the force on
the probe, X its place along the stroke, f its face. In the plane I is (l1 - l2)^2 of the principal stretches.
Without q: k/2 (Jbar - 1)^2, Jbar being the projection of J on the functions of q. Coulomb friction has no
potential; `contact_residual` has its virtual work.

The integral over the surface is taken over the undeformed surface by Simpson's rule, whose points are the
nodes (`surface_quadrature`), so that each node has a multiplier and a gap of its own. In the plane and in
space alike y, the second coordinate, points out of the tissue, and the probe slides along x.

Every form is a scikit-fem form; `body_fields` and `face_fields` give their parameters. `reference.py` solves
a stroke with nothing else; tests/sim/tissue/test_forms.py holds the kernels to them. Units: mm, kPa, N/m.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from skfem import BilinearForm, Element, Functional, LinearForm
from skfem.element import DiscreteField
from skfem.helpers import ddot, det, dot, grad, identity, inv, mul, transpose

from palpate.sim.tissue.law import EXPONENTIAL, phi

Floats = NDArray[np.float64]

UP, ALONG = 1, 0
"""Coordinates that the probe presses down and slides along."""


class ElementLinearPressure(Element):
    """{1, x, y} of the body's own coordinates, in space {1, x, y, z}, free in each element.

    Parameters
    ----------
    refdom : type
        Reference domain of the mesh: `RefQuad` or `RefHex`.
    """

    maxdeg = 1

    def __init__(self, refdom: Any) -> None:
        self.refdom = refdom
        self.interior_dofs = 1 + refdom.dim()
        self.dofnames = ["q"] * self.interior_dofs
        self.doflocs = np.full((self.interior_dofs, refdom.dim()), 0.5)

    def gbasis(self, mapping: Any, X: Floats, i: int, tind: Any = None) -> tuple[DiscreteField, ...]:
        """1, or a coordinate from the element's middle."""
        if i == 0:
            return (
                DiscreteField(np.ones((mapping.mesh.nelements if tind is None else len(tind), X.shape[-1]))),
            )
        x = mapping.F(X, tind)
        middle = mapping.F(np.full((len(x), 1), 0.5), tind)
        return (DiscreteField(x[i - 1] - middle[i - 1]),)


# --- the body ---------------------------------------------------------------------------------------------


def cofactor(F: Floats) -> Floats:
    """J F^-T, the derivative of J by F."""
    F = np.asarray(F)  # `inv` fills its result in place, which a DiscreteField does not take
    return det(F) * transpose(inv(F))


def cofactor_change(F: Floats, H: Floats) -> Floats:
    """Change of the cofactor with a change `H` of F: ((C:H) C - C H^T C) / J."""
    C = cofactor(F)
    return (ddot(C, H) * C - np.einsum("ij...,kj...,kl...->il...", C, H, C)) / det(F)


def body_fields(
    u: Any, q: Any, mu: Floats, bulk: Floats, stiffening: Floats, law: int = EXPONENTIAL
) -> dict[str, Any]:
    """Parameters of `energy`, `residual` and `tangent` at displacement `u` and pressure `q`.

    Parameters
    ----------
    u, q : DiscreteField
        As `basis.interpolate` gives them; mm, kPa.
    mu, bulk, stiffening : ndarray (M,)
        Shear modulus, lambda' + mu and b of each element, kPa, kPa, 1.
    law : int
        How they stiffen, by its place in `case.LAWS`.
    """
    F = identity(grad(u)) + grad(u)
    I = ddot(F, F) - len(F) - 2 * (det(F) - 1)
    value, first, second = phi(law, I, stiffening[:, None] + 0 * I)
    return {
        "F": F, "C": cofactor(F), "J": det(F), "q": q,
        "mu": mu[:, None] + 0 * I, "k": bulk[:, None] + 0 * I, "phi": value, "phi1": first, "phi2": second,
    }  # fmt: skip


@Functional
def energy(w: Any) -> Floats:
    """mu/2 phi(I) + q (J - 1) - q^2 / (2 k): with the q of `tangent`'s last row, the elastic energy."""
    return w.mu / 2 * w.phi + w.q * (w.J - 1) - w.q**2 / (2 * w.k)


@LinearForm
def residual(v: Any, p: Any, w: Any) -> Floats:
    """P : grad v + p (J - 1 - q/k), with the first Piola stress P = mu phi' (F - cof F) + q cof F."""
    stress = w.mu * w.phi1 * (w.F - w.C) + w.q * w.C
    return ddot(stress, grad(v)) + p * (w.J - 1 - w.q / w.k)


@BilinearForm
def tangent(du: Any, dq: Any, v: Any, p: Any, w: Any) -> Floats:
    """Change of `residual` with du and dq; H = grad du, S = F - cof F.

    2 mu phi'' (S:H) (S:grad v) + mu phi' H:grad v + (q - mu phi') dcof F[H]:grad v
    + dq cof F:grad v + p cof F:H - p dq / k
    """
    H, V, S = grad(du), grad(v), w.F - w.C
    return (
        2 * w.mu * w.phi2 * ddot(S, H) * ddot(S, V)
        + w.mu * w.phi1 * ddot(H, V)
        + (w.q - w.mu * w.phi1) * ddot(cofactor_change(w.F, H), V)
        + dq * ddot(w.C, V)
        + p * ddot(w.C, H)
        - p * dq / w.k
    )


# --- the contact ------------------------------------------------------------------------------------------


class FaceCurve(Protocol):
    """The probe's face: `face(s)` at places `s` (dim, ...) from its middle, mm."""

    def __call__(self, s: Floats) -> tuple[Floats, Floats, Floats]:
        """Height f (...), mm, its gradient (dim, ...) and its second derivatives (dim, dim, ...), 1/mm.

        Nothing depends on, and nothing is derived by, the coordinate `UP`.
        """


def surface_quadrature(dim: int) -> tuple[Floats, Floats]:
    """Simpson's rule on a facet: points (dim - 1, n) and weights (n,) for a mesh of dimension `dim`."""
    points, weights = np.array([0.0, 0.5, 1.0]), np.array([1.0, 4.0, 1.0]) / 6
    if dim == 2:
        return points[None], weights
    return np.stack(np.meshgrid(points, points)).reshape(2, 9), np.outer(weights, weights).ravel()


def face_fields(
    x: Any, u: Any, multiplier: Any, height: float, place: float, face: FaceCurve, friction: float
) -> dict[str, Any]:
    """Parameters of the contact's forms.

    Parameters
    ----------
    x, u, multiplier : DiscreteField
        Coordinates, displacement and multiplier at the points of `surface_quadrature`; mm, mm, kPa. The
        multiplier is 0 where there is no contact.
    height, place : float
        Where the probe's lowest point is, mm.
    friction : float
        Coulomb's coefficient.
    """
    now = np.array(x) + np.array(u)
    s = now.copy()
    s[ALONG] -= place
    f, slope, bend = face(s)
    normal, drag = -slope, np.zeros_like(slope)
    normal[UP] = 1.0
    drag[ALONG], drag[UP] = friction, friction * slope[ALONG]
    return {
        "multiplier": multiplier, "gap": now[UP] - height - f, "bend": bend, "friction": friction,
        "normal": normal, "traction": normal - drag,
    }  # fmt: skip


@LinearForm
def contact_residual(v: Any, w: Any) -> Floats:
    """lambda (n - mu t) . v: the face's normal n = (-f', 1), the probe's drag along t = (1, f')."""
    return w.multiplier * dot(w.traction, v)


@BilinearForm
def contact_tangent(du: Any, v: Any, w: Any) -> Floats:
    """Change of `contact_residual` with du, the multiplier as it is: -lambda (f'' du) . (v + mu v_y t0).

    t0 is the direction along which the probe slides.
    """
    turned = mul(w.bend, du)
    return -w.multiplier * (dot(turned, v) + w.friction * turned[ALONG] * v[UP])


@BilinearForm
def contact_traction(change: Any, v: Any, w: Any) -> Floats:
    """Change of `contact_residual` with the multiplier's `change`."""
    return change * dot(w.traction, v)


@BilinearForm
def contact_approach(du: Any, m: Any, w: Any) -> Floats:
    """Change of the gap with du: m n . du, without friction the transpose of `contact_traction`."""
    return m * dot(w.normal, du)


@LinearForm
def contact_gap(m: Any, w: Any) -> Floats:
    """The gap, each node's weighted by its share of the surface: 0 where there is contact."""
    return m * w.gap


@LinearForm
def surface_share(m: Any, w: Any) -> Floats:
    """Each node's share of the surface; minus the change of `contact_gap` with the probe's height."""
    return m
