"""What an element's kernels need, from scikit-fem: gradients, volumes and pressure functions at 27 Gauss
points.

Displacement is triquadratic; pressure is linear, free in each element and condensed there. The energy is

    W = mu/2 I + (lambda + mu)/2 (Jbar - 1)^2,    I = F:F - 1 - 2 J,

where tissue stiffens mu/2b (exp(b I) - 1) in place of mu/2 I (`palpate.sim.tissue.forms` has the weak form),
with Jbar the projection of J on {1, x, y, z}; under plane strain it is the plane solver's. Units: mm, kPa.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skfem import CellBasis, ElementHex0, ElementHex2

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.errors import FoldedElement
from palpate.sim.tissue.layers import LUMP, by_material, layer_at
from palpate.sim.tissue.solid.mesh import SolidMesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

POINTS = 27
LANES = 32
"""Gauss points, and the length of the vectors that hold them: filled up with points of no volume."""

_DIGITS = 12
"""Of a node's place in mm: elements that are alike to these digits have one shape. A derivative's step moves
nodes by 1e-7 mm."""


@dataclass(frozen=True)
class SolidIntegrals:
    """Of every element of a mesh, whatever it is made of; most of them share a few shapes.

    Attributes
    ----------
    shape : ndarray (M,)
        Which of the S shapes each element has.
    dN : ndarray (S, 3, 27, LANES)
        Gradients of the shape functions at the Gauss points.
    Ndx : ndarray (S, 4, LANES)
        Pressure functions, orthonormal in the element, times the points' volumes.
    dx : ndarray (M, LANES)
        The points' volumes.
    y : ndarray (M, LANES)
        Heights of the points.
    volume : ndarray (M,)
    """

    shape: Ints
    dN: Floats
    Ndx: Floats
    dx: Floats
    y: Floats
    volume: Floats


def integrate(mesh: SolidMesh) -> SolidIntegrals:
    """Gradients and volumes of all elements of `mesh`.

    Raises
    ------
    FoldedElement
        Its Jacobian is not positive.
    """
    corners = mesh.nodes_mm[mesh.elements]
    rows = (corners - corners[:, :1]).round(_DIGITS).reshape(len(corners), -1)
    _, first, shape = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    # three by three by three Gauss points
    basis = CellBasis(mesh.fem, ElementHex0(), intorder=5, elements=first)
    # once, where a basis of ElementHex2 would for each of its functions
    inverse = basis.mapping.invDF(basis.X, first)
    if not (basis.dx > 0).all() or basis.dx.shape[1] != POINTS or not _right_handed(corners[first]):
        raise FoldedElement("the lump cannot be meshed: an element is folded over")
    count = len(first)
    dN, dx = np.zeros((count, 3, 27, LANES)), np.zeros((count, LANES))
    for a in range(27):
        _, slope = ElementHex2().lbasis(basis.X, a)
        dN[:, :, a, :POINTS] = np.einsum("ijep,ip->ejp", inverse, slope)
    dx[:, :POINTS] = basis.dx
    where = np.asarray(basis.global_coordinates())
    linear = np.ones((count, 4, POINTS))
    linear[:, 1:] = (where - where.mean(2, keepdims=True)).transpose(1, 0, 2)
    gram = np.einsum("ekp,elp,ep->ekl", linear, linear, basis.dx)
    orthonormal = np.linalg.solve(np.linalg.cholesky(gram), linear)
    Ndx = np.zeros((count, 4, LANES))
    Ndx[:, :, :POINTS] = orthonormal * basis.dx[:, None]
    y = np.zeros((len(corners), LANES))
    y[:, :POINTS] = (where[1] - corners[first, 0, 1][:, None])[shape] + corners[:, 0, 1][:, None]
    return SolidIntegrals(shape, dN, Ndx, dx[shape], y, dx.sum(1)[shape])


def _right_handed(corners: Floats) -> bool:
    """scikit-fem takes volumes without their sign: the corner at (1, 1, 1) and its three neighbours have
    it."""
    edges = corners[:, [3, 2, 1]] - corners[:, [0]]
    return bool((np.linalg.det(edges) < 0).all())


@dataclass(frozen=True)
class SolidElasticity:
    """Constants per Gauss point, so that a border may cut an element, and the stiffness that never changes.

    Attributes
    ----------
    mu_dx : ndarray (M, LANES)
        Shear modulus times volume.
    b : ndarray (M, LANES)
        b of the exponential law; 0 where the tissue is linear.
    stiffening : ndarray (M,), bool
        Elements with a b.
    bulk : ndarray (M,)
        lambda + mu, mean over the element.
    kind : ndarray (M,)
        Which of the elements' kinds, by shape and moduli, each one is.
    L : ndarray (kinds, 27, 27)
        Integral of mu grad N_a . grad N_b.
    """

    mu_dx: Floats
    b: Floats
    stiffening: NDArray[np.bool_]
    bulk: Floats
    kind: Ints
    L: Floats


def elasticity(case: Case, mesh: SolidMesh, integrals: SolidIntegrals) -> SolidElasticity:
    """The constants of layers and lump. Without a lump its place is filled by fat and gland."""
    I, nu = integrals, case.poisson
    material = np.where(mesh.lump[:, None] & case.has_lump, LUMP, layer_at(I.y, mesh.grid.borders))
    young = case.fat_kPa * by_material([layer.ratio for layer in case.layers], case.E_ratio)[material]
    b = by_material([layer.stiffening for layer in case.layers], case.lump_stiffening)[material]
    b = np.where(I.dx > 0, b, 0.0)
    mu_dx = young / (2 * (1 + nu)) * I.dx
    bulk_of_mu = 2 * nu / (1 - 2 * nu) + 1
    rows = np.column_stack([I.shape, mu_dx])
    _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    flat = I.dN[I.shape[first]].transpose(0, 2, 1, 3).reshape(len(first), 27, -1)
    L = (flat * np.tile(mu_dx[first], 3)[:, None]) @ flat.transpose(0, 2, 1)
    bulk = bulk_of_mu * mu_dx.sum(1) / I.volume
    return SolidElasticity(mu_dx, b, np.asarray((b > 0).any(1)), bulk, kind, L)
