"""Contact of the surface's nodes with the probe's face.

Collocation: node i may not pass the face, y_i <= Y + f(x_i - X), Y being the probe's height; its multiplier
times the weight w_i of Simpson's rule is the force on it. The probe is above, so `gap` > 0 is penetration.
Units: mm, kPa, N/m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.tissue.mesh import TissueMesh
from sim.tissue.probe_shape import SENSOR_PITCH_MM, SENSORS_MM, ProbeShape

Floats = NDArray[np.float64]

_SWITCH = 50.0
"""kPa/mm: weighs penetration against multiplier when the active set is chosen."""


@dataclass(frozen=True)
class ContactState:
    """What the active set saw: indices into the surface's nodes, and the values there."""

    active: NDArray[np.int64]
    gap: Floats
    slope: Floats
    curvature: Floats
    force: Floats


class Contact:
    """The surface of `mesh` under a probe of the given shape and friction coefficient.

    `augmentation` (kPa/mm) is the stiffness that eliminates the multipliers: the constraint stays exact
    whatever it is, but the smaller, the more iterations; the larger, the more digits are rounded away.
    """

    def __init__(
        self, mesh: TissueMesh, shape: ProbeShape, friction: float, augmentation: float = 1e6
    ) -> None:
        self.shape, self.friction, self.augmentation = shape, friction, augmentation
        self.x_dof = 2 * mesh.surface
        self.x0, self.y0 = mesh.nodes_mm[mesh.surface].T.copy()
        side = self.x0[2::2] - self.x0[:-2:2]
        self.weight = np.zeros(len(self.x0))
        self.weight[:-2:2] += side / 6
        self.weight[2::2] += side / 6
        self.weight[1::2] += 4 * side / 6

    def evaluate(self, u: Floats, multiplier: Floats, height: float, position: float) -> ContactState:
        """Choose the active set (primal-dual) and evaluate it."""
        x = self.x0 + u[self.x_dof]
        f, slope, curvature = self.shape.height(x - position)
        gap = self.y0 + u[self.x_dof + 1] - height - f
        active = np.nonzero(multiplier + _SWITCH * gap > 0.0)[0]
        force = self.weight[active] * multiplier[active]
        return ContactState(active, gap[active], slope[active], curvature[active], force)

    def add_residual(self, state: ContactState, residual: Floats) -> None:
        """Add minus the forces on the tissue: normal, and the drag of a probe sliding to the right."""
        x = self.x_dof[state.active]
        residual[x] -= state.force * (state.slope + self.friction)
        residual[x + 1] += state.force * (1.0 - self.friction * state.slope)

    def vertical_force(self, state: ContactState) -> float:
        """What the tissue bears, N/m."""
        return float(np.sum(state.force * (1.0 - self.friction * state.slope)))

    def stiffness(self, state: ContactState, curved: bool = True) -> Floats:
        """Blocks (S, 3) of xx, xy, yy that the contact adds to the tangent."""
        blocks = np.zeros((len(self.x0), 3))
        k, g = self.augmentation * self.weight[state.active], -state.slope
        bend = np.maximum(state.force, 0.0) * state.curvature if curved else 0.0
        blocks[state.active] = np.stack([k * g * g - bend, k * g, k], -1)
        return blocks

    def pressure(self, u: Floats, multiplier: Floats) -> tuple[Floats, Floats, float]:
        """Deformed places (S,), mm, pressures (S,), kPa, and their integral, N/m.

        A node's pressure is its force over the deformed integral of its shape function.
        """
        x = self.x0 + u[self.x_dof]
        a, b, c = x[:-2:2], x[1::2], x[2::2]
        area = np.zeros(len(x))
        area[:-2:2] += (-3 * a + 4 * b - c) / 6
        area[1::2] += 4 * (c - a) / 6
        area[2::2] += (a - 4 * b + 3 * c) / 6
        pressure = np.where(multiplier > 0, multiplier * self.weight / area, 0.0)
        return x, pressure, float(pressure @ area)


_SAMPLES = np.linspace(-SENSOR_PITCH_MM / 2, SENSOR_PITCH_MM / 2, 9)
_SAMPLE_WEIGHTS = np.array([0.5, *[1.0] * 7, 0.5]) / 8


def read_sensors(s_mm: Floats, pressure_kPa: Floats) -> Floats:
    """Mean pressure over each of the sixteen sensors, kPa, from a profile in the probe's frame."""
    places = SENSORS_MM[:, None] + _SAMPLES
    return np.interp(places.ravel(), s_mm, pressure_kPa).reshape(places.shape) @ _SAMPLE_WEIGHTS
