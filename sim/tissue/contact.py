"""Contact of the surface's nodes with the probe's face.

Collocation: node i may not pass the face, y_i <= Y + f(x_i - X) + c lambda_i, Y being the probe's height
and c how far its padding gives way. The multiplier lambda_i times the weight w_i of Simpson's rule is the
force on it. The probe is above, so `gap` > 0 is penetration.
Units: mm, kPa, N/m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue import contact_kernels as kernels
from palpate.sim.tissue.mesh import TissueMesh
from palpate.sim.tissue.probe_shape import ProbeShape

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ContactState:
    """What the active set saw: indices into the surface's nodes, and the values there.

    `lift` is the vertical part of `force`.
    """

    active: NDArray[np.int64]
    gap: Floats
    slope: Floats
    curvature: Floats
    force: Floats
    lift: Floats


class Contact:
    """The surface of `mesh` under a probe of the given shape and friction coefficient.

    `augmentation` (kPa/mm) is the stiffness that eliminates the multipliers: the constraint stays exact
    whatever it is, but the smaller, the more iterations; the larger, the more digits are rounded away. A
    padding (mm/kPa) is a spring in series with it.
    """

    def __init__(
        self,
        mesh: TissueMesh,
        shape: ProbeShape,
        friction: float,
        augmentation: float = 1e6,
        padding_mm_per_kPa: float = 0.0,
    ) -> None:
        self.shape, self.friction, self.padding = shape, friction, padding_mm_per_kPa
        self.augmentation = augmentation / (1 + augmentation * padding_mm_per_kPa)
        self.x_dof = 2 * mesh.surface
        self.x0, self.y0 = mesh.nodes_mm[mesh.surface].T.copy()
        side = self.x0[2::2] - self.x0[:-2:2]
        self.weight = np.zeros(len(self.x0))
        self.weight[:-2:2] += side / 6
        self.weight[2::2] += side / 6
        self.weight[1::2] += 4 * side / 6

    def evaluate(self, u: Floats, multiplier: Floats, height: float, position: float) -> ContactState:
        """Choose the active set (primal-dual) and evaluate it; all other multipliers (S,) are set to 0."""
        f, slope, curvature = self.shape.height(kernels.places(self.x0, self.x_dof, u, position))
        return ContactState(
            *kernels.choose(
                self.y0,
                self.x_dof,
                u,
                multiplier,
                self.weight,
                height,
                f,
                slope,
                curvature,
                self.friction,
                self.padding,
            )
        )

    def balance(self, state: ContactState, held: NDArray[np.int64], forces: Floats) -> float:
        """Add minus the forces on the tissue to `forces` (2N,), clear what is held; the largest that is left.

        The forces are normal ones, and the drag of a probe sliding to the right.
        """
        return kernels.balance(
            forces, self.x_dof, state.active, state.force, state.slope, state.lift, self.friction, held
        )

    def vertical_force(self, state: ContactState) -> float:
        """What the tissue bears, N/m."""
        return float(np.add.reduce(state.lift))

    def stiffness(self, state: ContactState, curved: bool = True) -> Floats:
        """Blocks (S, 3) of xx, xy, yy that the contact adds to the tangent."""
        blocks = np.zeros((len(self.x0), 3))
        kernels.stiffness(
            state.active,
            self.weight,
            state.slope,
            state.curvature,
            state.force,
            self.augmentation,
            curved,
            blocks,
        )
        return blocks

    def pressure(self, u: Floats, multiplier: Floats, position: float) -> tuple[Floats, Floats, float]:
        """Deformed places (S,), mm, pressures (S,), kPa, and the vertical force of it all, N/m.

        A node's pressure is its force over the deformed integral of its shape function. The drag of a probe
        that slides to the right acts along the face: on a slope f' it takes friction f' of the pressure.
        """
        x, pressure, area = kernels.pressures(self.x0, self.x_dof, u, multiplier, self.weight)
        force = pressure * area
        _, slope, _ = self.shape.height(x - position)
        return x, pressure, float(force.sum() - self.friction * (force @ slope))

    def pressure_derivatives(
        self, u: Floats, multiplier: Floats, du: Floats, dmultiplier: Floats
    ) -> tuple[Floats, Floats]:
        """How places and pressures (k, S) change with displacements du (k, 2N) and multipliers (k, S)."""
        _, pressure, area = kernels.pressures(self.x0, self.x_dof, u, multiplier, self.weight)
        dx = du[:, self.x_dof]
        a, b, c = dx[:, :-2:2], dx[:, 1:-1:2], dx[:, 2::2]
        darea = np.zeros_like(dx)
        darea[:, :-2:2] += (-3 * a + 4 * b - c) / 6
        darea[:, 1:-1:2] += 4 * (c - a) / 6
        darea[:, 2::2] += (a - 4 * b + 3 * c) / 6
        return dx, np.where(pressure > 0, (dmultiplier * self.weight - pressure * darea) / area, 0.0)
