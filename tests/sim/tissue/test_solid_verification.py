"""The solid finite elements are right: known answers, the weak form, invariance."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from skfem import Basis, ElementHex2, ElementVector

from palpate.sim.tissue import Case, Settings, forms, simulate
from palpate.sim.tissue.probe_shape import ProbeShape
from palpate.sim.tissue.solid import kernels
from palpate.sim.tissue.solid.body import Body
from palpate.sim.tissue.solid.element import elasticity, integrate
from palpate.sim.tissue.solid.face import FaceShape
from palpate.sim.tissue.solid.fronts import lay_fronts
from palpate.sim.tissue.solid.grid import lay_grid
from palpate.sim.tissue.solid.mesh import build_mesh
from palpate.sim.tissue.solid.multifrontal import Multifrontal
from tests.sim.tissue.solid_blocks import FLAT, block, body_of, press


def shaken(seed=1):
    return block([-10, -5.5, -2, 3, 10], [-8, -5, -2.4, 0], [-6, -1, 2, 6], shake=0.3, seed=seed)


@pytest.mark.parametrize("nu", [0.3, 0.495])
def test_a_flat_face_on_a_distorted_mesh_presses_evenly(nu):
    skin, _ = press(
        body_of(shaken(), nu=nu), FLAT, force=240 * 2.0, depth=0.05, tolerance=1e-11, augmentation=1e3
    )
    np.testing.assert_allclose(skin.pressure, 2.0, rtol=1e-9)


def test_hertz_point_contact_within_a_percent():
    radius, young, nu, a = 200.0, 10.0, 0.3, 8.0
    plane = young / (1 - nu**2)
    force = 4 / 3 * plane * a**3 / radius
    peak = 3 * force / (2 * math.pi * a * a)
    side = np.concatenate([np.arange(0.0, 9.1, 1.5), [11, 16, 30, 80, 250]])
    y = -np.array([250, 90, 40, 20, 11, 6.5, 4, 2.4, 1.1, 0.0])
    ball = FaceShape(ProbeShape(radius, 1e6, 1.0), ProbeShape(radius, 1e6, 1.0))
    # The rollers at x = 0 and z = 0 make a quarter of it.
    skin, state = press(body_of(block(side, y, side), young, nu), ball, force / 4, 0.3)
    exact = peak * np.sqrt(np.maximum(1 - (skin.x**2 + skin.z**2) / a**2, 0))
    inside = np.hypot(skin.x, skin.z) < 0.8 * a
    assert skin.pressure[0, 0] == pytest.approx(peak, rel=0.01)
    assert np.sqrt(np.mean((skin.pressure - exact)[inside] ** 2)) < 0.01 * peak
    assert -state.height == pytest.approx(a * a / radius, rel=0.03)  # the block is 250 mm deep, not endless


def test_rigid_motion_costs_nothing():
    body = body_of(shaken(), nu=0.45, stiffening=5.0)
    rng = np.random.default_rng(4)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    X = body.mesh.nodes_mm
    assert np.abs(body.forces((X @ turn.T + [1.0, 2.0, 3.0] - X).ravel())).max() < 1e-9
    u = rng.normal(0, 0.05, X.shape)
    turned = (X + u) @ turn.T - X
    np.testing.assert_allclose(
        body.forces(turned.ravel()).reshape(-1, 3), body.forces(u.ravel()).reshape(-1, 3) @ turn.T, atol=1e-9
    )


@pytest.mark.parametrize(
    "code", ["d10h08e10f10_ball", "d10h08eNLf10_ball_t15_sf6_sg16", "d10h08e01f10_ellipsoid8x4_y3_t14"]
)
def test_kernels_are_the_weak_form_on_every_material(code):
    """Where a border cuts no element, each has one material, and scikit-fem assembles the same numbers."""
    case = Case.from_code(code)
    mesh = build_mesh(lay_grid(case, Settings(hx_mm=4.0), 0.0, 0.0))
    integrals = integrate(mesh)
    constants = elasticity(case, mesh, integrals)
    whole = np.array([np.ptp(b[dx > 0]) == 0 for b, dx in zip(constants.b, integrals.dx)])
    mu = constants.mu_dx[:, 0] / integrals.dx[:, 0]
    whole &= np.isclose(constants.mu_dx, mu[:, None] * integrals.dx, rtol=1e-12).all(1)
    assert whole.all() or "ellipsoid" in code
    some = np.nonzero(whole)[0]
    some = some[:: max(1, len(some) // 50)]
    assert len(set(zip(mu[some].round(9), constants.b[some, 0]))) == (3 if case.has_lump else 2)

    basis = Basis(
        mesh.fem,
        ElementVector(ElementHex2()) * forms.ElementLinearPressure(mesh.fem.refdom),
        intorder=5,
        elements=some,
    )
    displacement = basis.split_bases()[0]
    own = (
        displacement.nodal_dofs,
        displacement.edge_dofs,
        displacement.facet_dofs,
        displacement.interior_dofs,
    )
    moved, pressed = basis.split_indices()
    theirs = moved[np.concatenate(own, 1)]
    assert theirs.shape == (3, len(mesh.nodes_mm))
    X, rng = mesh.nodes_mm, np.random.default_rng(5)
    u = 0.3 * np.sin(X / 9 + [0, 1, 2]) + rng.normal(0, 0.002, X.shape)
    vector = np.zeros(basis.N)
    vector[theirs] = u.T

    body, count = Body(mesh, integrals, constants), len(mesh.elements)
    q = constants.bulk[:, None] * body.residual(u.ravel(), np.zeros((count, 4)), np.zeros((count, 4, 81)))[1]
    K, frozen = np.zeros((len(some), 81, 81)), np.zeros((count, 4, 81))
    body.tangent(u.ravel(), q, some, K, frozen)
    pressure = (
        np.einsum("ek,ekp->ep", q[some], integrals.Ndx[integrals.shape[some], :, :27])
        / integrals.dx[some, :27]
    )
    w = forms.body_fields(
        basis.interpolate(vector)[0], pressure, mu[some], constants.bulk[some], constants.b[some, 0]
    )
    force = forms.residual.assemble(basis, **w)[theirs].T
    np.testing.assert_allclose(_forces_of(body, some, u, q), force, atol=1e-10 * np.abs(force).max())

    A = forms.tangent.assemble(basis, **w).tocsr()
    v = np.zeros(basis.N)
    v[theirs] = rng.normal(size=(3, len(X)))
    change = A @ v
    # The pressures are condensed element by element: their block of A is diagonal by elements.
    here = np.intersect1d(pressed, np.unique(basis.element_dofs))
    inner = spsolve(A[here][:, here].tocsc(), change[here])
    condensed = (change - A[:, here] @ inner)[theirs].T
    product = _times(K, mesh.elements[some], v[theirs].T)
    np.testing.assert_allclose(product, condensed, atol=1e-10 * np.abs(condensed).max())


@pytest.mark.parametrize("stiffening", [0.0, 5.0])
def test_with_a_fresh_tangent_the_forces_do_not_depend_on_the_pressures_given(stiffening):
    """At equilibrium the pressures are right anyway, so no stroke shows a fault in what corrects them."""
    body = body_of(shaken(), nu=0.495, stiffening=stiffening)
    m, rng = len(body.mesh.elements), np.random.default_rng(7)
    u, q = rng.normal(0, 0.05, body.mesh.nodes_mm.size), rng.normal(0, 1.0, (m, 4))
    K, frozen = np.zeros((m, 81, 81)), np.zeros((m, 4, 81))
    body.tangent(u, q, np.arange(m), K, frozen)
    true = body.forces(u)
    np.testing.assert_allclose(body.residual(u, q, frozen)[0], true, atol=1e-12 * np.abs(true).max())


def _forces_of(body, some, u, q):
    """Forces of some elements only."""
    mesh, I, c = body.mesh, body.integrals, body.constants
    R, theta = np.zeros(u.size), np.zeros((len(some), 4))
    kernels.residual(
        u.ravel(), q[some], np.zeros((len(some), 4, 81)), mesh.elements[some], I.shape[some], I.dN, I.Ndx,
        c.mu_dx[some], c.b[some], c.stiffening[some], c.bulk[some], R, theta,
    )  # fmt: skip
    return R.reshape(-1, 3)


def _times(K, elements, v):
    out = np.zeros_like(v)
    upper = np.triu(K)
    whole = upper + np.triu(upper, 1).transpose(0, 2, 1)
    product = np.einsum("eij,ej->ei", whole, v[elements].reshape(len(K), 81))
    np.add.at(out, elements, product.reshape(len(K), 27, 3))
    return out


def test_the_factor_solves_the_tangent_and_renews_what_has_changed():
    body = body_of(block(np.arange(0, 21, 2.5), [-9, -6, -3, -1, 0], np.arange(0, 11, 2.5)), nu=0.45)
    mesh = body.mesh
    m, n = len(mesh.elements), 3 * len(mesh.nodes_mm)
    K, frozen = np.zeros((m, 81, 81), np.float32), np.zeros((m, 4, 81))
    u, q = np.zeros(n), np.zeros((m, 4))
    solver = Multifrontal(lay_fronts(mesh))
    body.tangent(u, q, np.arange(m), K, frozen)
    solver.factor(lambda which, into: np.copyto(into, K[which]))
    whole = solver.flops
    some = np.nonzero(mesh.nodes_mm[mesh.elements].mean(1)[:, 0] < 6)[0]
    K[some] *= 1.5
    solver.change_elements(some)
    blocks = np.zeros((mesh.surface.size, 3, 3), np.float32)
    blocks[3] = 40.0 * np.eye(3)
    solver.change_contact(blocks)
    solver.factor(lambda which, into: np.copyto(into, K[which]))
    assert 0 < solver.flops < 0.9 * whole
    rng = np.random.default_rng(6)
    for count in (1, 2, 5):
        sides = rng.normal(size=(count, n))
        sides[:, mesh.fixed.ravel()] = 0
        for side, found in zip(sides, solver.solve(sides)):
            back = _times(K.astype(float), mesh.elements, found.reshape(-1, 3))
            back[mesh.surface.ravel()[3]] += 40.0 * found.reshape(-1, 3)[mesh.surface.ravel()[3]]
            back[mesh.fixed] = 0
            np.testing.assert_allclose(back.ravel(), side, atol=1e-3)


def test_a_lump_without_end_across_is_the_plane_strain_stroke():
    """Under a face that is flat across, over tissue of 150 mm: the force of 39 mm on all of it."""
    plane = simulate(Case.from_code("d10h08e10f08"), None, [-28.0, 0.0])
    wide = Case.from_code("d10h08e10f10_ellipsoid1000x5_Rainf_wa100")
    solid = simulate(replace(wide, F_rel=0.8 * 150 / 39), None, [-28.0, 0.0])
    np.testing.assert_allclose(solid.displacement_mm, plane.displacement_mm, rtol=0.005)
    np.testing.assert_allclose(np.ptp(solid.images_kPa, 2), 0.0, atol=1e-5)
    difference = solid.images_kPa[:, 1:-1, 0] - plane.images_kPa[:, 1:-1]
    assert np.abs(difference).max() < 0.01 * plane.images_kPa.max()
