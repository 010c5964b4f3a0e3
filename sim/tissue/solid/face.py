"""Contact of the skin's nodes with the probe's face, and what the face's sensors read.

As in the plane: collocation, y_i <= Y + f(x_i - X, z_i), Y being the probe's height; a node's multiplier
times its weight, the integral of its shape function over the undeformed skin, is the force on it. The probe
is above, so `gap` > 0 is penetration. Units: mm, kPa, mN (1 mN = 1 kPa mm^2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.border import last_over_next
from palpate.sim.tissue.face_sensors import PITCH_MM
from palpate.sim.tissue.probe_shape import ProbeShape
from palpate.sim.tissue.solid import face_kernels as kernels
from palpate.sim.tissue.solid.mesh import SolidMesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_SWITCH = 50.0
"""kPa/mm: weighs penetration against multiplier when the active set is chosen."""


ACROSS_FIELDS = {
    "across_radius_mm": "probe_radius_mm",
    "across_half_mm": "face_half_mm",
    "across_fillet_per_mm2": "fillet_per_mm2",
}
"""A case's fields of the face across the stroke, and those of the same meaning along it."""


@dataclass(frozen=True)
class FaceShape:
    """Height of the face over its lowest point: the sum of an arc along the stroke and one across it."""

    along: ProbeShape
    across: ProbeShape

    def height(self, x: Floats, z: Floats) -> tuple[Floats, Floats, Floats]:
        """f (n,), its slopes (n, 2) and its curvatures (n, 2) in x and z, at places in the probe's frame."""
        fx, sx, bx = self.along.height(x)
        fz, sz, bz = self.across.height(z)
        return fx + fz, np.stack([sx, sz], -1), np.stack([bx, bz], -1)

    def derivatives(self, x: Floats, z: Floats, by: str) -> tuple[Floats, Floats]:
        """Of f (n,) and its slopes (n, 2) by a field of the face's, along or across."""
        if by in ACROSS_FIELDS:
            f, slope = self.across.derivatives(z, ACROSS_FIELDS[by])
            return f, np.stack([np.zeros_like(slope), slope], -1)
        f, slope = self.along.derivatives(x, by)
        return f, np.stack([slope, np.zeros_like(slope)], -1)


@dataclass(frozen=True)
class Touching:
    """What the active set saw: indices into the skin's nodes, and the values there.

    Attributes
    ----------
    active : ndarray (n,)
    gap : ndarray (n,)
    normal : ndarray (n, 3)
        (-f_x, 1, -f_z); the vertical part is 1, so the sum of the forces is what the probe bears.
    curvature : ndarray (n, 2)
    force : ndarray (n,)
        Multiplier times weight.
    """

    active: Ints
    gap: Floats
    normal: Floats
    curvature: Floats
    force: Floats


class FaceContact:
    """The skin of `mesh` under a face.

    `augmentation` (kPa/mm) is the stiffness that eliminates the multipliers: the constraint stays exact
    whatever it is, but the larger, the more of single precision's digits are rounded away.
    """

    def __init__(self, mesh: SolidMesh, shape: FaceShape, augmentation: float = 1e4) -> None:
        self.shape, self.augmentation = shape, augmentation
        self.nodes = mesh.surface.ravel()
        self.dofs = 3 * self.nodes[:, None] + np.arange(3)
        self.x0, self.y0, self.z0 = mesh.nodes_mm[self.nodes].T.copy()
        self._lattice = mesh.surface.shape
        self._lattice_x = self.x0.reshape(self._lattice)[:, 0].copy()
        self._lattice_z = self.z0.reshape(self._lattice)[0].copy()
        self._last_over_next = last_over_next(self._lattice_x), last_over_next(self._lattice_z)
        self.weight = _integrals(self.x0.reshape(self._lattice), self.z0.reshape(self._lattice)).ravel()

    def evaluate(self, u: Floats, multiplier: Floats, height: float, position: float) -> Touching:
        """Choose the active set (primal-dual) and evaluate it; all other multipliers (S,) are set to 0."""
        moved = u[self.dofs]
        f, slope, curvature = self.shape.height(self.x0 + moved[:, 0] - position, self.z0 + moved[:, 2])
        gap = self.y0 + moved[:, 1] - height - f
        touches = multiplier + _SWITCH * gap > 0.0
        multiplier[~touches] = 0.0
        active = np.nonzero(touches)[0]
        normal = np.stack([-slope[active, 0], np.ones(len(active)), -slope[active, 1]], -1)
        force = self.weight[active] * multiplier[active]
        return Touching(active, gap[active], normal, curvature[active], force)

    def push(self, seen: Touching, forces: Floats) -> None:
        """Add minus the contact's forces on the tissue to `forces` (3N,)."""
        forces[self.dofs[seen.active]] += seen.force[:, None] * seen.normal

    def stiffness(self, seen: Touching, curved: bool = True) -> NDArray[np.float32]:
        """Blocks (S, 3, 3) that the contact adds to the tangent."""
        some = self.augmentation * self.weight[seen.active]
        block = some[:, None, None] * seen.normal[:, :, None] * seen.normal[:, None, :]
        if curved:
            bend = np.maximum(seen.force, 0.0)[:, None] * seen.curvature
            block[:, 0, 0] -= bend[:, 0]
            block[:, 2, 2] -= bend[:, 1]
        out = np.zeros((len(self.nodes), 3, 3), np.float32)
        out[seen.active] = block
        return out

    def pressure(self, u: Floats, multiplier: Floats) -> Profile:
        """The pressure on the face: a node's is its force over the deformed integral of its shape
        function."""
        x = (self.x0 + u[self.dofs[:, 0]]).reshape(self._lattice)
        z = (self.z0 + u[self.dofs[:, 2]]).reshape(self._lattice)
        area = _integrals(x, z)
        force = (np.maximum(multiplier, 0.0) * self.weight).reshape(self._lattice)
        pressure = np.divide(force, area, out=np.zeros_like(force), where=force > 0)
        square = kernels.to_border(x, z, pressure, *self._last_over_next)
        return Profile(self._lattice_x, self._lattice_z, x, z, pressure, square, float(force.sum()))


@dataclass(frozen=True)
class Profile:
    """The skin's lattice under pressure.

    Attributes
    ----------
    x0, z0 : ndarray (2 nx + 1,), (2 nz + 1,)
        Lines of the undeformed lattice.
    x, z, pressure : ndarray (2 nx + 1, 2 nz + 1)
        Where its nodes are now, and the pressure on them.
    square : ndarray (2 nx + 1, 2 nz + 1)
        What is straight between the nodes: the pressure's square, below 0 beyond the contact's border.
    force : float
        Sum of the vertical forces, mN.
    """

    x0: Floats
    z0: Floats
    x: Floats
    z: Floats
    pressure: Floats
    square: Floats
    force: float

    def read(self, position: float, along_mm: Floats, across_mm: Floats, mirrored: bool) -> Floats:
        """Mean pressure over each sensor, kPa, (along, across), of a probe that stands at `position`.

        `mirrored` tells that the lattice is the half z >= 0 of a symmetric one.
        """
        parts = (np.arange(_PARTS + 1) / _PARTS - 0.5) * PITCH_MM
        x = position + along_mm[:, None] + parts
        z = across_mm[:, None] + parts
        z = np.abs(z) if mirrored else z
        return np.asarray(kernels.mean_pressures(self.x0, self.z0, self.x, self.z, self.square, x, z))


_PARTS = 5
"""Each way, of a sensor; what is straight in each is the pressure's square."""


def _integrals(x: Floats, z: Floats) -> Floats:
    """Integrals (2 nx + 1, 2 nz + 1) of the nodes' shape functions over the skin, seen from above, whose
    nodes are at x and z."""
    points, weights = np.polynomial.legendre.leggauss(3)
    s = (points + 1) / 2
    N = np.stack([(1 - s) * (1 - 2 * s), 4 * s * (1 - s), s * (2 * s - 1)], -1)
    D = np.stack([4 * s - 3, 4 - 8 * s, 4 * s - 1], -1)
    rows = 2 * np.arange(x.shape[0] // 2)[:, None] + np.arange(3)
    columns = 2 * np.arange(x.shape[1] // 2)[:, None] + np.arange(3)
    patch = (rows[:, None, :, None], columns[None, :, None, :])

    def at(values: Floats, a: Floats, b: Floats) -> Floats:
        return np.asarray(np.einsum("efij,pi,qj->efpq", values[patch], a, b, optimize=True))

    jacobian = at(x, D, N) * at(z, N, D) - at(x, N, D) * at(z, D, N)
    shares = np.einsum("efpq,p,q,pi,qj->efij", jacobian, weights / 2, weights / 2, N, N, optimize=True)
    out = np.zeros(x.shape)
    np.add.at(out, patch, shares)
    return out
