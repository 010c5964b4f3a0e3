"""The compiled kernels compute what the forms say, on every material; so does the whole stroke."""

import functools
from dataclasses import dataclass

import numpy as np
import pytest

from palpate.sim.tissue import Case, Settings, forms, simulate
from palpate.sim.tissue.contact import Contact
from palpate.sim.tissue.element import integrate
from palpate.sim.tissue.material import Tissue, elasticity
from palpate.sim.tissue.mesh import build_mesh
from palpate.sim.tissue.probe_shape import ProbeShape
from palpate.sim.tissue.reference import WeakForm

MATERIALS = [
    "d10h08e10f10",
    "d10h08eNLf10",
    "d20h03e1Kf10_nu0.49999",
    "d10h08e02f10_sf6_sg16",
    "d10h08e10f10_sf2000_nu0.3",  # so stiff that most of it is on the law's straight part
    "d10h08e10f10_ogden_sf6_sl900",
]


@dataclass(frozen=True)
class Both:
    """One body as the kernels and as the forms see it, at the same random state."""

    tissue: Tissue
    weak: WeakForm
    u: np.ndarray
    q: np.ndarray
    pressure: np.ndarray

    @property
    def elements(self):
        return np.arange(len(self.q))

    def assembled(self):
        return forms.residual.assemble(self.weak.basis, **self.weak.body(self.u, self.q))


@functools.cache
def both(code: str) -> Both:
    """A state whose pressures are the forms' `q`, and in the kernels' orthonormal functions `pressure`."""
    case = Case.from_code(code)
    mesh = build_mesh(case, Settings(hx_mm=4.0), -4.0, 0.0)
    tissue = Tissue(mesh, integrate(mesh), elasticity(case, mesh))
    weak = WeakForm(mesh, tissue.constants)
    rng = np.random.default_rng(11)
    m = len(mesh.elements)
    q = rng.normal(0, 1.0, (m, 3)) * [1.0, 0.1, 0.1]
    functions = weak.basis.split_bases()[1]
    N = np.stack([functions.basis[k][0] for k in range(3)])  # (3, M, 9)
    mass = np.einsum("jep,kep,ep->ejk", N, N, functions.dx)
    # The kernels' functions come from Gram-Schmidt, so their coefficients from Cholesky.
    pressure = np.einsum("ekj,ek->ej", np.linalg.cholesky(mass), q)
    return Both(tissue, weak, rng.normal(0, 0.05, 2 * len(mesh.nodes_mm)), q, pressure)


def close(ours, theirs, tolerance=1e-10):
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance * np.abs(theirs).max())


def test_gradients_and_areas_are_those_of_scikit_fems_basis():
    b = both(MATERIALS[0])
    displacement = b.weak.basis.split_bases()[0]
    mesh, I = b.tissue.mesh, b.tissue.integrals
    np.testing.assert_array_equal(displacement.element_dofs[::2].T // 2, mesh.quads.dofs.element_dofs.T)
    close(I.dx, displacement.dx, 1e-14)
    for a in range(9):
        node = int(np.nonzero(mesh.quads.dofs.element_dofs[:, 0] == mesh.elements[0, a])[0][0])
        close(I.dN[:, :, :, a], displacement.basis[2 * node][0].grad[0].transpose(1, 2, 0), 1e-13)


@pytest.mark.parametrize("code", MATERIALS)
def test_the_kernels_forces_are_the_forms_residual(code):
    b = both(code)
    m = len(b.q)
    K, frozen = np.empty((m, 18, 18)), np.empty((m, 3, 18))
    b.tissue.tangent(b.u, b.pressure, b.elements, K, frozen)
    true, mixed, theta = b.tissue.residual(b.u, b.pressure, frozen)
    excess = b.pressure - b.tissue.constants.bulk[:, None] * theta
    at_q = true.copy()
    nodes = b.tissue.mesh.elements
    push = np.einsum("ek,ekn->en", excess, frozen)
    np.add.at(at_q, np.concatenate([2 * nodes, 2 * nodes + 1], 1), push)
    residual = b.assembled()
    close(at_q, residual[b.weak.moved])
    close(mixed, true)  # where the tangent is not old, whatever the pressures
    # The other rows: each function's volume change, less what the pressure says.
    rows = residual[b.weak.pressed].reshape(m, 3)
    energy = np.einsum("ek,ek->e", rows, b.q)
    close(np.einsum("ek,ek->e", theta - b.pressure / b.tissue.constants.bulk[:, None], b.pressure), energy)


@pytest.mark.parametrize("code", MATERIALS)
def test_some_elements_alone_have_the_stiffness_that_they_have_among_all(code):
    b = both(code)
    m = len(b.q)
    (all_of_them, some), frozen = np.zeros((2, m, 18, 18)), np.empty((m, 3, 18))
    which = np.flatnonzero(np.random.default_rng(3).random(m) < 0.4)
    b.tissue.tangent(b.u, b.pressure, b.elements, all_of_them, frozen)
    b.tissue.tangent(b.u, b.pressure, which, some, frozen)
    np.testing.assert_array_equal(some[which], all_of_them[which])
    assert not np.delete(some, which, 0).any()


@pytest.mark.parametrize("code", MATERIALS)
def test_the_kernels_stiffness_is_the_forms_tangent_with_the_pressures_eliminated(code):
    b = both(code)
    m = len(b.q)
    K, frozen = np.empty((m, 18, 18)), np.empty((m, 3, 18))
    b.tissue.tangent(b.u, b.pressure, b.elements, K, frozen)
    A = forms.tangent.assemble(b.weak.basis, **b.weak.body(b.u, b.q))
    moved, pressed = b.weak.moved, b.weak.pressed
    direction = np.random.default_rng(5).normal(size=(len(moved), 3))
    through = A[pressed][:, moved] @ direction
    block = A[pressed][:, pressed].toarray().reshape(m, 3, m, 3)[b.elements, :, b.elements]
    change = -np.linalg.solve(block, through.reshape(m, 3, -1)).reshape(through.shape)
    theirs = A[moved][:, moved] @ direction + A[moved][:, pressed] @ change
    nodes = b.tissue.mesh.elements
    dofs = np.concatenate([2 * nodes, 2 * nodes + 1], 1)
    ours = np.zeros_like(theirs)
    np.add.at(ours, dofs, np.einsum("eab,ebk->eak", K, direction[dofs]))
    close(ours, theirs)


def test_the_least_volume_is_the_forms_least_determinant():
    b = both(MATERIALS[0])
    least = b.weak.body(b.u, b.q)["J"].min()
    assert b.tissue.smallest_jacobian(b.u) == pytest.approx(least, rel=1e-10)


@pytest.mark.parametrize("radius", [40.0, np.inf])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_the_contacts_kernels_are_its_forms(friction, radius):
    b = both(MATERIALS[0])
    mesh, shape = b.tissue.mesh, ProbeShape(radius, 10.0, 0.1)
    contact = Contact(mesh, shape, friction, augmentation=7.0)
    height, place = mesh.nodes_mm[:, 1].max() - 1.0, -1.0
    pressure = np.random.default_rng(6).uniform(1, 9, len(mesh.surface))
    state = contact.evaluate(b.u, pressure, height, place)
    assert 3 < len(state.active) < len(mesh.surface)
    everywhere = np.zeros(len(mesh.nodes_mm))
    everywhere[mesh.surface] = pressure  # what does not touch has been cleared
    w = b.weak.face(b.u, everywhere, height, place, shape, friction)
    surface, nodes = b.weak.surface, mesh.surface
    close(contact.weight, b.weak.share[nodes], 1e-14)
    close(state.gap, b.weak.gap(w)[nodes[state.active]])
    theirs = forms.contact_residual.assemble(surface, **w)
    ours = np.zeros_like(theirs)
    contact.balance(state, np.empty(0, np.int64), ours)
    close(ours, theirs)
    assert contact.vertical_force(state) == pytest.approx(theirs[1::2].sum(), rel=1e-12)
    if not friction:  # with friction the kernels' stiffness is the frictionless one: symmetric, near enough
        approach = forms.contact_approach.assemble(surface, b.weak.shares, **w)[nodes[state.active]]
        stiffness = forms.contact_tangent.assemble(surface, **w) + 7.0 * approach.T @ (
            approach / b.weak.share[nodes[state.active], None]
        )
        x = 2 * nodes
        close(
            contact.stiffness(state).T,
            np.stack([stiffness[i, j] for i, j in ((x, x), (x, x + 1), (x + 1, x + 1))]),
        )


@pytest.mark.parametrize("code", ["d10h08eNLf10_sf6_sg16", "d10h08e10f05_mu0.2"])
def test_a_stroke_is_the_reference_stroke(code):
    case, places = Case.from_code(code), [-2.0, 0.0]
    reference = simulate(case, Settings(hx_mm=4.0, solver="reference"), places)
    tight = simulate(case, Settings(hx_mm=4.0, tolerance=1e-10), places)
    close(tight.images_kPa, reference.images_kPa, 1e-9)
    close(tight.displacement_mm, reference.displacement_mm, 1e-10)
    usual = simulate(case, Settings(hx_mm=4.0), places)
    close(usual.images_kPa, reference.images_kPa, 1e-5)
