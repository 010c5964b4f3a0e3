"""Stiffness of every element, and the tissue's residual and tangent as compiled kernels.

Linear tissue is neo-Hookean at large strain (`element.py` has the energy); `law.py` has how tissue stiffens.
Displacements are vectors (2N,), x and y of each node in turn. Units: mm, kPa; forces in N/m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue import kernels
from palpate.sim.tissue.case import LAWS, Case
from palpate.sim.tissue.element import ElementIntegrals
from palpate.sim.tissue.lanes import pack_points
from palpate.sim.tissue.law import EXPONENTIAL
from palpate.sim.tissue.layers import FAT, GLAND, LUMP, by_material
from palpate.sim.tissue.mesh import TissueMesh

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Elasticity:
    """Constants per element.

    Attributes
    ----------
    mu, bulk : ndarray (M,)
        Shear modulus and lambda + mu, kPa.
    stiffening : ndarray (M,)
        b of the law; 0 where the tissue is linear.
    law : int
        Its place in `case.LAWS`.
    """

    mu: Floats
    bulk: Floats
    stiffening: Floats
    law: int = EXPONENTIAL


def elasticity(case: Case, mesh: TissueMesh) -> Elasticity:
    """The constants of layers and lump. Without a lump its place is filled by fat and gland."""
    material = mesh.material
    if not case.has_lump:
        above = mesh.nodes_mm[mesh.elements[:, 4], 1] > 0.0
        material = np.where(material == LUMP, np.where(above, FAT, GLAND), material)
    young = case.fat_kPa * by_material([layer.ratio for layer in case.layers], case.E_ratio)[material]
    b = by_material([layer.stiffening for layer in case.layers], case.lump_stiffening)[material]
    nu = case.poisson
    mu = young / (2 * (1 + nu))
    return Elasticity(mu, young * nu / ((1 + nu) * (1 - 2 * nu)) + mu, b, LAWS.index(case.law))


class Stiffening:
    """The elements that stiffen, laid out for the kernels.

    Parameters
    ----------
    mesh, integrals, constants
        As of `Tissue`.
    which : ndarray (n,), int
        Their numbers, ascending.
    """

    def __init__(
        self, mesh: TissueMesh, integrals: ElementIntegrals, constants: Elasticity, which: NDArray[np.int64]
    ) -> None:
        self._which, self._nodes = which, mesh.elements[which]
        self._points = pack_points(integrals.dN[which], integrals.dx[which])
        self._mu, self._b, self._law = constants.mu[which], constants.stiffening[which], constants.law
        self._at = np.full(len(mesh.elements), -1)
        self._at[which] = np.arange(len(which))

    def __len__(self) -> int:
        return len(self._which)

    def residual(self, u: Floats, out: Floats, more: float = 0.0) -> None:
        """Add their forces at displacement `u` (2N,) to `out`, with b larger by so much."""
        kernels.stiffening_residual(u, self._nodes, self._points, self._mu, self._law, self._b + more, out)

    def tangent(self, u: Floats, which: NDArray[np.int64], K: Floats) -> None:
        """Add the stiffness of those among the elements `which` to K (M, 18, 18)."""
        at = self._at[which]
        kernels.stiffening_tangent(
            u, self._nodes, at[at >= 0], self._which, self._points, self._mu, self._law, self._b, K
        )


class Tissue:
    """The elastic body: residual and element tangents at a displacement.

    Parameters
    ----------
    mesh, integrals : TissueMesh, ElementIntegrals
        Its geometry.
    constants : Elasticity
        Its stiffness.
    """

    def __init__(self, mesh: TissueMesh, integrals: ElementIntegrals, constants: Elasticity) -> None:
        self.mesh, self.integrals, self.constants = mesh, integrals, constants
        self.mu_linear = np.where(constants.stiffening > 0, 0.0, constants.mu)
        which = np.nonzero((constants.stiffening > 0) & (constants.mu != 0))[0]
        self._stiffening = Stiffening(mesh, integrals, constants, which)
        self._gradients = np.zeros((len(mesh.elements), 3, 18))
        self._excess = np.zeros((len(mesh.elements), 3))

    def residual(self, u: Floats, q: Floats, frozen: Floats) -> tuple[Floats, Floats, Floats]:
        """Internal forces at displacement `u` (2N,).

        Parameters
        ----------
        q : ndarray (M, 3)
            Pressures, unknowns of their own while Newton's iteration runs.
        frozen : ndarray (M, 3, 18)
            Volume gradients of the tangent in use.

        Returns
        -------
        true, mixed : ndarray (2N,)
            Forces with the pressure that belongs to `u`; and the right-hand side of the mixed method,
            condensed with the gradients of the tangent: with an old tangent only this converges well, since
            the bulk modulus does not multiply the tangent's age.
        theta : ndarray (M, 3)
            Volume change.
        """
        I, c, elements = self.integrals, self.constants, self.mesh.elements
        true, excess, theta = np.zeros_like(u), np.zeros_like(u), np.empty_like(q)
        kernels.residual(
            u, q, frozen, elements, I.packed, self.mu_linear, c.bulk,
            true, excess, theta, self._gradients, self._excess,
        )  # fmt: skip
        if len(self._stiffening):
            self._stiffening.residual(u, true)
        excess += true
        return true, excess, theta

    def mixed(self, true: Floats, frozen: Floats) -> Floats:
        """The mixed right-hand side (2N,) again, where only `frozen` (M, 3, 18) has changed since `residual`.

        `true` is what `residual` gave. A quarter of its work, and the same bits.
        """
        out = np.zeros_like(true)
        kernels.mixed(self._excess, self._gradients, frozen, self.mesh.elements, out)
        out += true
        return out

    def tangent(self, u: Floats, q: Floats, which: NDArray[np.int64], K: Floats, frozen: Floats) -> None:
        """Fill, for the elements `which`, stiffnesses K (M, 18, 18), nine x then nine y, and `frozen`.

        With the pressures `q` as unknowns of their own (condensed element by element) Newton's method needs
        half of the iterations.
        """
        I, c, elements = self.integrals, self.constants, self.mesh.elements
        kernels.tangent(u, q, which, elements, I.g, I.C, I.L, I.C0, self.mu_linear, c.bulk, K, frozen)
        if len(self._stiffening):
            self._stiffening.tangent(u, which, K)

    def pressure(self, du: Floats, theta: Floats, frozen: Floats) -> Floats:
        """Pressures (M, 3) after the step `du`, to first order with the gradients `frozen`."""
        return kernels.pressure(du, self.mesh.elements, theta, frozen, self.constants.bulk)

    def smallest_jacobian(self, u: Floats) -> float:
        """Smallest determinant of the deformation gradient at any Gauss point; below 0 is inverted."""
        return float(kernels.smallest_jacobian(u, self.mesh.elements, self.integrals.dN))
