"""Stiffness of every element, and the tissue's residual and tangent as compiled kernels.

Linear tissue is neo-Hookean at large strain (`element.py` has the energy); stiffening tissue follows
W = mu/(2b) (exp(b I) - 1) with I = (l1 - l2)^2 = F:F - 2J, of which b -> 0 is the same neo-Hookean law.
Displacements are vectors (2N,), x and y of each node in turn. Units: mm, kPa; forces in N/m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.tissue import kernels
from sim.tissue.case import Case
from sim.tissue.element import ElementIntegrals
from sim.tissue.mesh import FAT, GLAND, LUMP, TissueMesh

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Elasticity:
    """Constants per element.

    Attributes
    ----------
    mu, bulk : ndarray (M,)
        Shear modulus and lambda + mu, kPa.
    stiffening : ndarray (M,)
        b of the exponential law; 0 where the tissue is linear.
    """

    mu: Floats
    bulk: Floats
    stiffening: Floats


def elasticity(case: Case, mesh: TissueMesh) -> Elasticity:
    """The constants of fat, gland and lump. Without a lump its place is filled by fat and gland."""
    material = mesh.material
    if not case.has_lump:
        above = mesh.nodes_mm[mesh.elements[:, 4], 1] > 0.0
        material = np.where(material == LUMP, np.where(above, FAT, GLAND), material)
    young = case.fat_kPa * np.array([1.0, case.gland_ratio, case.E_ratio])[material]
    b = np.array([case.fat_stiffening, case.gland_stiffening, case.lump_stiffening])[material]
    nu = case.poisson
    mu = young / (2 * (1 + nu))
    return Elasticity(mu, young * nu / ((1 + nu) * (1 - 2 * nu)) + mu, b)


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
        self.stiffening_elements = np.nonzero(constants.stiffening > 0)[0]

    def residual(self, u: Floats) -> Floats:
        """Internal forces (2N,) at displacement `u` (2N,)."""
        I, R = self.integrals, np.zeros_like(u)
        kernels.residual(u, self.mesh.elements, I.g, I.C, I.L, I.C0, self.mu_linear, self.constants.bulk, R)
        if len(self.stiffening_elements):
            kernels.stiffening_residual(
                u, self.mesh.elements, self.stiffening_elements, I.dN, I.dx,
                self.constants.mu, self.constants.stiffening, R,
            )  # fmt: skip
        return R

    def tangent(self, u: Floats, q: Floats) -> Floats:
        """Element stiffnesses (M, 18, 18), nine x then nine y, with pressures `q` (M, 3) held apart.

        The pressure in the geometric term is an unknown of its own during Newton's iteration (a mixed
        method condensed element by element), which saves half of the iterations.
        """
        I, K = self.integrals, np.empty((len(self.mesh.elements), 18, 18))
        kernels.tangent(u, q, self.mesh.elements, I.g, I.C, I.L, I.C0, self.mu_linear, self.constants.bulk, K)
        if len(self.stiffening_elements):
            kernels.stiffening_tangent(
                u, self.mesh.elements, self.stiffening_elements, I.dN, I.dx,
                self.constants.mu, self.constants.stiffening, K,
            )  # fmt: skip
        return K

    def pressure(self, u: Floats, du: Floats) -> Floats:
        """Pressure coefficients (M, 3) at `u`, linearised over the step `du`."""
        I = self.integrals
        return kernels.pressure(u, du, self.mesh.elements, I.g, I.C, self.constants.bulk)

    def smallest_jacobian(self, u: Floats) -> float:
        """Smallest determinant of the deformation gradient at any Gauss point; below 0 is inverted."""
        return float(kernels.smallest_jacobian(u, self.mesh.elements, self.integrals.dN))
