"""Fields for people: strain, pressure and principal stretches in the tissue.

What the Gauss points know is projected by scikit-fem onto the nodes, tissue by tissue, so that nothing is
smeared over the border of a lump; nodes of a border stand twice. Units: mm, kPa.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu
from skfem import Basis, ElementQuad2, LinearForm, MeshQuad2
from skfem.models.poisson import mass

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.layers import MATERIALS
from palpate.sim.tissue.reference import WeakForm
from palpate.sim.tissue.result import Stroke
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.state import State
from palpate.sim.tissue.stroke import simulate

if TYPE_CHECKING:
    from palpate.sim.tissue.run import StrokeRun

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Fields:
    """The tissue at one position of the probe, node by node.

    Attributes
    ----------
    position_mm : float
        Of the probe's middle; the lump is at 0.
    points_mm : ndarray (P, 2), round a solid lump (P, 3)
        The nodes at rest; those on a border between tissues stand once for either.
    cells : ndarray (M, 9) or (M, 27)
        Nodes of each element, in VTK's order.
    material : ndarray (M,)
        Numbers in `layers.MATERIALS`: 0 fat, 1 gland, 2 lump.
    values : dict of str to ndarray (P,) or (P, n)
        `displacement_mm` (x, y, 0); `strain` of Green and Lagrange (xx, yy, zz, xy, yz, xz); `stretch_1` and
        `stretch_2`, the principal stretches in the plane, the larger first (round a solid lump all three);
        `volume_ratio`; `pressure_kPa`,
        minus the mean of Cauchy's three normal stresses; `contact_pressure_kPa`, 0 off the surface.
    """

    position_mm: float
    points_mm: Floats
    cells: NDArray[np.int64]
    material: NDArray[np.int64]
    values: dict[str, Floats]


def simulate_fields(
    case: Case, settings: Settings | None = None, positions_mm: Sequence[float] | None = None
) -> tuple[Stroke, list[Fields]]:
    """As `simulate`, with the fields at every position.

    Raises
    ------
    CaseError, StrokeError
        As `simulate`.
    """
    if case.solid:
        from palpate.sim.tissue.solid.fields import simulate_fields as solid_fields

        return solid_fields(case, settings, positions_mm)
    seen: list[tuple[StrokeRun, float, State]] = []
    stroke = simulate(case, settings, positions_mm, lambda *what: seen.append(what))
    projector = _Projector(seen[0][0])
    return stroke, [projector(run, position, state) for run, position, state in seen]


class _Projector:
    """Projects on one mesh; the projections' matrices are factored once."""

    def __init__(self, run: StrokeRun) -> None:
        mesh = run.mesh
        self._weak = WeakForm(mesh, run.tissue.constants)
        self._cells = mesh.quads.dofs.element_dofs
        there = [np.nonzero(mesh.material == m)[0] for m in range(len(MATERIALS))]
        self._parts = [_Part(mesh.quads, elements) for elements in there if len(elements)]
        self._nodes = np.concatenate([part.nodes for part in self._parts])
        order = np.concatenate([part.elements for part in self._parts])
        self._material = mesh.material[order]
        starts = np.cumsum([0, *(len(part.nodes) for part in self._parts[:-1])])
        self._where = np.concatenate(
            [n + np.searchsorted(p.nodes, self._cells[:, p.elements]).T for n, p in zip(starts, self._parts)]
        )

    def __call__(self, run: StrokeRun, position: float, state: State) -> Fields:
        mesh, weak = run.mesh, self._weak
        displacement = state.u.reshape(-1, 2)[self._nodes]
        _, contact, _ = run.contact.pressure(state.u, state.multiplier, position)
        on_surface = np.zeros(len(mesh.nodes_mm))
        on_surface[mesh.surface] = contact
        values = {
            "displacement_mm": np.column_stack([displacement, np.zeros(len(displacement))]),
            "contact_pressure_kPa": on_surface[self._nodes],
        }
        for name, field in _at_gauss_points(weak, state.u).items():
            # One column for each component, (..., M, 9) to (P, ...).
            parts = [part.project(field.reshape(-1, *field.shape[-2:])) for part in self._parts]
            values[name] = np.concatenate(parts).reshape(-1, *field.shape[:-2])
        return Fields(position, mesh.nodes_mm[self._nodes], self._where, self._material, values)


class _Part:
    """One tissue: its elements, its nodes and the projection onto them."""

    def __init__(self, quads: MeshQuad2, elements: NDArray[np.int64]) -> None:
        self.elements = elements
        self._basis = Basis(quads, ElementQuad2(), intorder=5, elements=elements)
        self.nodes = np.unique(self._basis.element_dofs)
        self._solve = splu(mass.assemble(self._basis)[self.nodes][:, self.nodes].tocsc()).solve

    def project(self, fields: Floats) -> Floats:
        """Fields (n, M, 9) of the whole mesh onto this part's nodes, (P, n)."""
        loads = [_load.assemble(self._basis, f=field[self.elements]) for field in fields]
        return self._solve(np.stack(loads, -1)[self.nodes])


@LinearForm
def _load(v: Any, w: Any) -> Floats:
    return w.f * v


def _at_gauss_points(weak: WeakForm, u: Floats) -> dict[str, Floats]:
    """The fields (..., M, 9) of a displacement (2N,), with the pressure that belongs to it.

    Plane strain: F33 = 1. Cauchy's stress is P F^T / J, so that its mean is q + mu phi' (F:F / 3J - 1), F:F
    being that of the solid.
    """
    pressures = weak.basis.split_bases()[1]
    w = weak.body(u, np.zeros((weak.basis.nelems, 3)))
    q = pressures.interpolate(pressures.project(w["k"] * (w["J"] - 1)))
    F, J = w["F"], w["J"]
    right = np.einsum("ki...,kj...->ij...", F, F)  # Cauchy and Green's F^T F
    half, turn = (right[0, 0] + right[1, 1]) / 2, np.hypot((right[0, 0] - right[1, 1]) / 2, right[0, 1])
    strain = (right - np.eye(2)[:, :, None, None]) / 2
    nothing = np.zeros_like(J)
    total = right[0, 0] + right[1, 1] + 1  # F:F
    return {
        "strain": np.stack([strain[0, 0], strain[1, 1], nothing, strain[0, 1], nothing, nothing]),
        "stretch_1": np.sqrt(half + turn),
        "stretch_2": np.sqrt(half - turn),
        "volume_ratio": J,
        "pressure_kPa": -np.asarray(q) - w["mu"] * w["phi1"] * (total / (3 * J) - 1),
    }
