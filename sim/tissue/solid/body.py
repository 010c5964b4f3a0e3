"""The elastic body in three dimensions: residual and element tangents at a displacement. Units: mm, kPa,
mN."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.solid import kernels
from palpate.sim.tissue.solid.element import SolidElasticity, SolidIntegrals
from palpate.sim.tissue.solid.mesh import SolidMesh

Floats = NDArray[np.float64]


class Body:
    """A mesh of a given elasticity.

    Displacements are vectors (3N,), x, y and z of each node in turn; `q` (M, 4) are the elements' pressures,
    unknowns of their own while Newton's iteration runs, and `frozen` (M, 4, 81) the volume gradients of the
    tangent in use.
    """

    def __init__(self, mesh: SolidMesh, integrals: SolidIntegrals, constants: SolidElasticity) -> None:
        self.mesh, self.integrals, self.constants = mesh, integrals, constants
        I, c = integrals, constants
        self._tables = (mesh.elements, I.shape, I.dN, I.Ndx, c.mu_dx, c.b, c.stiffening, c.bulk)

    def residual(self, u: Floats, q: Floats, frozen: Floats) -> tuple[Floats, Floats]:
        """The mixed method's right-hand side (3N,), and the volume change theta (M, 4).

        With an old tangent only this converges well, since the bulk modulus does not multiply the tangent's
        age.
        """
        forces, theta = np.zeros_like(u), np.empty_like(q)
        kernels.residual(u, q, frozen, *self._tables, forces, theta)
        return forces, theta

    def forces(self, u: Floats) -> Floats:
        """Internal forces (3N,) with the pressures that belong to `u`."""
        none = np.zeros((len(self.mesh.elements), 4, 81))
        _, theta = self.residual(u, np.zeros((len(self.mesh.elements), 4)), none)
        return self.residual(u, self.constants.bulk[:, None] * theta, none)[0]

    def tangent(self, u: Floats, q: Floats, which: NDArray[np.int64], K: NDArray, frozen: Floats) -> None:
        """Fill the upper triangles of the stiffnesses K (n, 81, 81) of the n elements `which`, and their
        `frozen`."""
        kernels.tangent(u, q, which, *self._tables, self.constants.kind, self.constants.L, K, frozen)

    def pressure(self, du: Floats, theta: Floats, frozen: Floats) -> Floats:
        """Pressures (M, 4) after the step `du`, to first order with the gradients `frozen`."""
        return kernels.pressure(du, self.mesh.elements, theta, frozen, self.constants.bulk)

    def smallest_jacobian(self, u: Floats) -> float:
        """Smallest determinant of the deformation gradient at any Gauss point; below 0 is inverted."""
        return float(
            kernels.smallest_jacobian(u, self.mesh.elements, self.integrals.shape, self.integrals.dN)
        )
