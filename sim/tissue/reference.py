"""The reference stroke: Newton's method on what scikit-fem assembles from `forms.py`, and nothing else.

Slow (half a minute where `newton.py` needs a tenth of a second) and as plain as the mathematics:
displacement, pressures, multipliers and the probe's height are the unknowns of one sparse system, its tangent
is renewed in every iteration, and there is no augmentation, condensation or old factor. `--solver reference`
puts it in the place of `newton.Newton`. Where it starts and in which steps the probe is pressed and moved is
shared: no equilibrium depends on that. Units: mm, kPa, N/m.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bmat, csr_array
from scipy.sparse.linalg import splu
from skfem import Basis, ElementQuad2, ElementVector, FacetBasis

from palpate.sim.tissue import forms
from palpate.sim.tissue.element import QUADRATURE
from palpate.sim.tissue.material import Elasticity
from palpate.sim.tissue.mesh import TissueMesh
from palpate.sim.tissue.newton import NoConvergence, Work
from palpate.sim.tissue.probe_shape import ProbeShape
from palpate.sim.tissue.state import State

Floats = NDArray[np.float64]

_TOLERANCE = 1e-9
"""Largest imbalance, as a fraction of the force: Newton's last step leaves far less."""

_SWITCH = 50.0
"""kPa/mm: weighs penetration against multiplier when the active set is chosen."""

_LARGEST_RISE_MM = 1.5
_SINK_MM = -0.2
"""How far the probe moves where it does not touch yet."""


class WeakForm:
    """The forms on one mesh, as vectors and matrices.

    Attributes
    ----------
    basis : Basis
        Of displacement and pressure together; `moved` and `pressed` are their places in its vectors.
    surface, shares : FacetBasis
        Of displacement and multiplier on the surface. A multiplier is a vector (N,) over all nodes.
    """

    def __init__(self, mesh: TissueMesh, constants: Elasticity) -> None:
        quads, c = mesh.quads, constants
        displacement = ElementVector(ElementQuad2())
        pressure = forms.ElementLinearPressure(quads.refdom)
        self.basis = Basis(quads, displacement * pressure, quadrature=QUADRATURE)
        self.moved, self.pressed = self.basis.split_indices()
        self.constants = c.mu, c.bulk, c.stiffening, c.law
        top = mesh.nodes_mm[:, 1].max()
        facets = quads.facets_satisfying(lambda x: x[1] == top, boundaries_only=True)
        rule = forms.surface_quadrature(2)
        self.surface = FacetBasis(quads, displacement, facets=facets, quadrature=rule)
        self.shares = FacetBasis(quads, ElementQuad2(), facets=facets, quadrature=rule)
        self.share = forms.surface_share.assemble(self.shares)

    def body(self, u: Floats, q: Floats) -> dict[str, Any]:
        """Parameters of the body's forms at `u` (2N,) and the coefficients `q` (M, 3) of {1, x, y}."""
        x = self.basis.zeros()
        x[self.moved], x[self.pressed] = u, q.ravel()
        moved, pressed = self.basis.interpolate(x)
        return forms.body_fields(moved, pressed, *self.constants)

    def face(
        self, u: Floats, multiplier: Floats, height: float, place: float, shape: ProbeShape, friction: float
    ) -> dict[str, Any]:
        """Parameters of the contact's forms."""
        return forms.face_fields(
            self.surface.global_coordinates(), self.surface.interpolate(u),
            self.shares.interpolate(multiplier), height, place, _face_of(shape), friction,
        )  # fmt: skip

    def gap(self, w: dict[str, Any]) -> Floats:
        """Every node's gap (N,), mm; 0 off the surface."""
        weighted = forms.contact_gap.assemble(self.shares, **w)
        return np.divide(weighted, self.share, out=np.zeros_like(weighted), where=self.share > 0)


def _face_of(shape: ProbeShape) -> forms.FaceCurve:
    def face(s: Floats) -> tuple[Floats, Floats, Floats]:
        f, slope, curvature = (v.reshape(s[0].shape) for v in shape.height(s[forms.ALONG].ravel()))
        gradient, bend = np.zeros_like(s), np.zeros((2, *s.shape))
        gradient[forms.ALONG], bend[forms.ALONG, forms.ALONG] = slope, curvature
        return f, gradient, bend

    return face


class ReferenceNewton:
    """Finds what `newton.Newton` finds; `pressure` of its states are coefficients of {1, x, y}."""

    def __init__(
        self, mesh: TissueMesh, constants: Elasticity, shape: ProbeShape, friction: float, tolerance: float
    ) -> None:
        self.mesh, self.shape, self.friction = mesh, shape, friction
        self.tolerance = min(tolerance, _TOLERANCE)
        self.weak = WeakForm(mesh, constants)
        self.counts = Work()
        self._stiffest = constants.bulk.max()
        held = np.zeros(self.weak.basis.N, bool)
        held[self.weak.moved[mesh.fixed.ravel()]] = True
        self._free = np.nonzero(~held)[0]
        n = len(self.weak.moved)
        self._spread = csr_array((np.ones(n), (self.weak.moved, np.arange(n))), (self.weak.basis.N, n))
        self._up = np.zeros(n)
        self._up[forms.UP :: 2] = 1.0

    def solve(
        self, start: State, position: float, force: float, limit: int = 30, careful: bool = False
    ) -> State:
        """As `newton.Newton.solve`; every iteration is a careful one.

        Raises
        ------
        NoConvergence
            It did not settle within `limit` iterations, or diverged.
        """
        state = start.copy()
        for _ in range(limit):
            multiplier, active, gap, face = self._contact(state, position)
            body = self.weak.body(state.u, state.pressure)
            contact = forms.contact_residual.assemble(self.weak.surface, **face)
            forces = forms.residual.assemble(self.weak.basis, **body)
            forces[self.weak.moved] += contact
            missing = force - contact[forms.UP :: 2].sum()
            error = self._error(forces, gap[active], missing) / force
            if not error < 1e6:
                raise NoConvergence("the iteration diverged")
            if error < self.tolerance and len(active):
                state.smallest_jacobian = float(body["J"].min())
                return state
            change = self._change(body, face, active, forces, gap[active], missing)
            scale = min(1.0, _LARGEST_RISE_MM / max(abs(change.height), 1e-12))
            state.u += scale * change.u
            state.pressure += scale * change.pressure
            multiplier += scale * change.multiplier
            state.multiplier = multiplier[self.mesh.surface]
            state.height += scale * change.height
            self.counts.iterations += 1
        raise NoConvergence(f"no equilibrium within {limit} iterations (still {error:.1e} of the force out)")

    def _contact(
        self, state: State, position: float
    ) -> tuple[Floats, NDArray[np.int64], Floats, dict[str, Any]]:
        """Multipliers (N,), the inactive ones cleared, active nodes, gaps (N,) and the forms' parameters."""
        surface, multiplier = self.mesh.surface, np.zeros(len(self.mesh.nodes_mm))
        multiplier[surface] = state.multiplier
        face = self.weak.face(state.u, multiplier, state.height, position, self.shape, self.friction)
        gap = self.weak.gap(face)
        touching = multiplier[surface] + _SWITCH * gap[surface] > 0.0
        multiplier[surface[~touching]] = 0.0
        face["multiplier"] = self.weak.shares.interpolate(multiplier)
        return multiplier, surface[touching], gap, face

    def _error(self, forces: Floats, gap: Floats, missing: float) -> float:
        """Largest force out of balance, N/m; errors of volume and gap as the forces that they amount to."""
        volume = self._stiffest * np.abs(forces[self.weak.pressed]).max()
        return max(
            np.abs(forces[self._free]).max(), volume, _SWITCH * np.abs(gap).max(initial=0.0), abs(missing)
        )

    def _change(
        self,
        body: dict[str, Any],
        face: dict[str, Any],
        active: NDArray[np.int64],
        forces: Floats,
        gap: Floats,
        missing: float,
    ) -> State:
        """Newton's step: the whole system, solved at once."""
        change = State(
            np.zeros(2 * len(self.mesh.nodes_mm)), 0.0, np.zeros(len(self.mesh.nodes_mm)), np.empty(0)
        )
        if not len(active):
            change.height, change.pressure = _SINK_MM, np.zeros((len(self.mesh.elements), 3))
            return change
        weak, free, spread = self.weak, self._free, self._spread
        self.counts.tangents += 1
        self.counts.factorisations += 1
        bend = forms.contact_tangent.assemble(weak.surface, **face)
        traction = forms.contact_traction.assemble(weak.shares, weak.surface, **face)[:, active]
        approach = forms.contact_approach.assemble(weak.surface, weak.shares, **face)[active]
        share, up = weak.share[active], self._up
        K = forms.tangent.assemble(weak.basis, **body) + spread @ bend @ spread.T
        system = bmat(
            [
                [K[free][:, free], (spread @ traction)[free], None],
                [(approach @ spread.T)[:, free], None, -share[:, None]],
                [((up @ bend) @ spread.T)[None, free], (up @ traction)[None], None],
            ],
            format="csc",
        )
        found = splu(system).solve(np.concatenate([-forces[free], -gap * share, [missing]]))
        x = weak.basis.zeros()
        x[free] = found[: len(free)]
        change.u, change.pressure = x[weak.moved], x[weak.pressed].reshape(-1, 3)
        change.multiplier[active], change.height = found[len(free) : -1], float(found[-1])
        return change
