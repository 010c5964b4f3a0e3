"""Strain, pressure and principal stretches in the tissue round a solid lump. Units: mm, kPa.

As in the plane (`palpate.sim.tissue.fields`): projected onto the nodes tissue by tissue, so that nothing is
smeared over the border of a lump. An element that a border cuts belongs to the tissue of most of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import diags
from scipy.sparse.linalg import cg
from skfem import Basis, ElementHex2, LinearForm
from skfem.models.poisson import mass

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.errors import StrokeError
from palpate.sim.tissue.fields import Fields
from palpate.sim.tissue.law import EXPONENTIAL, phi
from palpate.sim.tissue.layers import LUMP, MATERIALS, layer_at
from palpate.sim.tissue.settings import Settings
from palpate.sim.tissue.solid.element import POINTS
from palpate.sim.tissue.solid.mesh import LATTICE_OF_LOCAL, SolidMesh
from palpate.sim.tissue.solid.result import SolidStroke
from palpate.sim.tissue.solid.run import SolidRun
from palpate.sim.tissue.solid.stroke import simulate_forces
from palpate.sim.tissue.state import State

Floats = NDArray[np.float64]

_CORNERS = ((0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2))
_EDGES = (
    *((1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)),
    *((0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)),
)
_FACES = ((0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1), (1, 1, 0), (1, 1, 2), (1, 1, 1))
_VTK = [LATTICE_OF_LOCAL.tolist().index(a + 3 * b + 9 * c) for a, b, c in (*_CORNERS, *_EDGES, *_FACES)]
"""VTK's order of the 27 nodes, from scikit-fem's."""


def simulate_fields(
    case: Case, settings: Settings | None = None, positions_mm: Sequence[float] | None = None
) -> tuple[SolidStroke, list[Fields]]:
    """As `simulate`, with the fields at every position.

    Raises
    ------
    CaseError, StrokeError
        As `simulate`.
    """
    seen: list[tuple[SolidRun, float, list[State]]] = []
    stroke = simulate_forces(
        case, [case.F_rel], settings, positions_mm, visit=lambda *what: seen.append(what)
    )[0]
    projector = _Projector(seen[0][0])
    return stroke, [projector(position, states[0]) for _, position, states in seen]


class _Projector:
    """Projects on one mesh."""

    def __init__(self, run: SolidRun) -> None:
        self._run = run
        mesh, grid = run.mesh, run.mesh.grid
        integrals = run.newton.body.integrals
        at_points = layer_at(integrals.y, grid.borders)
        filled = [(integrals.dx * (at_points == m)).sum(1) for m in range(len(MATERIALS))]
        lump = mesh.lump & run.case.has_lump
        material = np.where(lump, LUMP, np.argmax(filled, 0))
        there = [np.nonzero(material == m)[0] for m in range(len(MATERIALS))]
        self._parts = [_Part(mesh, elements) for elements in there if len(elements)]
        self._nodes = np.concatenate([part.nodes for part in self._parts])
        self._material = np.concatenate([material[part.elements] for part in self._parts])
        starts = np.cumsum([0, *(len(part.nodes) for part in self._parts[:-1])])
        cells = [n + np.searchsorted(p.nodes, mesh.elements[p.elements]) for n, p in zip(starts, self._parts)]
        self._cells = np.concatenate(cells)[:, _VTK]

    def __call__(self, position: float, state: State) -> Fields:
        run = self._run
        contact = np.zeros(len(run.mesh.nodes_mm))
        contact[run.contact.nodes] = run.contact.pressure(state.u, state.multiplier).pressure.ravel()
        values = {
            "displacement_mm": state.u.reshape(-1, 3)[self._nodes],
            "contact_pressure_kPa": contact[self._nodes],
        }
        for name, field in self._at_gauss_points(state).items():
            parts = [part.project(field.reshape(-1, *field.shape[-2:])) for part in self._parts]
            values[name] = np.concatenate(parts).reshape(-1, *field.shape[:-2])
        return Fields(position, run.mesh.nodes_mm[self._nodes], self._cells, self._material, values)

    def _at_gauss_points(self, state: State) -> dict[str, Floats]:
        """The fields (..., M, 27); the mean of Cauchy's normal stresses is q + mu phi' (F:F / 3J - 1)."""
        body = self._run.newton.body
        I, c = body.integrals, body.constants
        u = state.u.reshape(-1, 3)[body.mesh.elements]
        gradient = np.einsum("eai,ejap->ijep", u, I.dN[I.shape][..., :POINTS], optimize=True)
        F = gradient + np.eye(3)[:, :, None, None]
        J = np.linalg.det(F.transpose(2, 3, 0, 1))
        right = np.einsum("kiep,kjep->ijep", F, F)
        strain = (right - np.eye(3)[:, :, None, None]) / 2
        stretches = np.sqrt(np.linalg.eigvalsh(right.transpose(2, 3, 0, 1)))
        dx = I.dx[:, :POINTS]
        q = np.einsum("ek,ekp->ep", state.pressure, I.Ndx[I.shape][..., :POINTS]) / dx
        total = right[0, 0] + right[1, 1] + right[2, 2]
        shear = c.mu_dx[:, :POINTS] / dx * phi(EXPONENTIAL, total - 1 - 2 * J, c.b[:, :POINTS])[1]
        return {
            "strain": np.stack([strain[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))]),
            **{f"stretch_{3 - k}": stretches[..., k] for k in (2, 1, 0)},
            "volume_ratio": J,
            "pressure_kPa": -q - shear * (total / (3 * J) - 1),
        }


class _Part:
    """One tissue: its elements, its nodes and the projection onto them."""

    def __init__(self, mesh: SolidMesh, elements: NDArray[np.int64]) -> None:
        self.elements = elements
        self._basis = Basis(mesh.fem, ElementHex2(), intorder=5, elements=elements)
        self.nodes = np.unique(self._basis.element_dofs)
        self._mass = mass.assemble(self._basis)[self.nodes][:, self.nodes].tocsr()
        self._scale = diags(1.0 / self._mass.diagonal())

    def project(self, fields: Floats) -> Floats:
        """Fields (n, M, 27) of the whole mesh onto this part's nodes, (P, n)."""
        out = []
        for field in fields:
            load = _load.assemble(self._basis, f=field[self.elements])[self.nodes]
            values, failed = cg(self._mass, load, rtol=1e-8, M=self._scale, maxiter=500)
            if failed:
                raise StrokeError("fields", 0.0, "what the Gauss points know could not be projected")
            out.append(values)
        return np.stack(out, -1)


@LinearForm
def _load(v: Any, w: Any) -> Floats:
    return w.f * v
