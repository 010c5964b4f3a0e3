"""The weak form is one: energy, residual and tangent belong together, in the plane and in space."""

import functools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from skfem import (
    Basis,
    ElementHex2,
    ElementQuad2,
    ElementVector,
    FacetBasis,
    MeshHex1,
    MeshHex2,
    MeshQuad1,
    MeshQuad2,
)

from palpate.sim.tissue import forms
from palpate.sim.tissue.law import EXPONENTIAL, OGDEN


@dataclass(frozen=True)
class Block:
    """A shaken block with constants that differ from element to element."""

    mesh: Any
    basis: Any
    surface: Any
    shares: Any
    mu: np.ndarray
    bulk: np.ndarray
    stiffening: np.ndarray
    law: int = EXPONENTIAL

    def at(self, x: np.ndarray) -> dict[str, Any]:
        return forms.body_fields(*self.basis.interpolate(x), self.mu, self.bulk, self.stiffening, self.law)

    def state(self, size: float, seed: int = 1) -> np.ndarray:
        """Displacements of about `size` mm, pressures of a few kPa."""
        rng = np.random.default_rng(seed)
        x = rng.normal(0, 3.0, self.basis.N)
        moved = self.basis.split_indices()[0]
        x[moved] = rng.normal(0, size, len(moved))
        return x


@functools.cache
def block(dim: int) -> Block:
    """Elements that do not stiffen, that stiffen a little and so much that the law is a line."""
    lines = [[-3.0, -1.0, 0.5, 2.0], [-2.0, 0.0], [-1.0, 0.6]][:dim]
    straight = (MeshQuad1 if dim == 2 else MeshHex1).init_tensor(*map(np.array, lines))
    mesh = (MeshQuad2 if dim == 2 else MeshHex2).from_mesh(straight)
    element = ElementQuad2() if dim == 2 else ElementHex2()
    rng = np.random.default_rng(7)
    top = mesh.facets_satisfying(lambda x: np.isclose(x[1], 0.0), boundaries_only=True)
    mesh.doflocs[:, mesh.doflocs[1] < -0.1] += rng.uniform(-0.1, 0.1, (dim, (mesh.doflocs[1] < -0.1).sum()))
    moved = ElementVector(element)
    rule = forms.surface_quadrature(dim)
    m = mesh.nelements
    return Block(
        mesh=mesh,
        basis=Basis(mesh, moved * forms.ElementLinearPressure(mesh.refdom), intorder=5),
        surface=FacetBasis(mesh, moved, facets=top, quadrature=rule),
        shares=FacetBasis(mesh, element, facets=top, quadrature=rule),
        mu=rng.uniform(3, 5, m),
        bulk=rng.uniform(100, 200, m),
        stiffening=np.resize([0.0, 3.0, 900.0], m),
    )


def slope_of(f, x, along, step=1e-4):
    """Derivative of `f` at `x` along a direction, of fourth order."""

    def g(s):
        return f(x + s * step * along)

    return (8 * (g(1) - g(-1)) - (g(2) - g(-2))) / (12 * step)


@pytest.mark.parametrize(("dim", "law"), [(2, EXPONENTIAL), (3, EXPONENTIAL), (2, OGDEN)])
def test_the_residual_is_the_derivative_of_the_energy(dim, law):
    body = replace(block(dim), law=law)
    x, direction = body.state(0.02), body.state(0.2, seed=2)
    slope = slope_of(lambda y: forms.energy.assemble(body.basis, **body.at(y)), x, direction)
    exact = forms.residual.assemble(body.basis, **body.at(x)) @ direction
    assert slope == pytest.approx(exact, rel=1e-8)


@pytest.mark.parametrize(("dim", "law"), [(2, EXPONENTIAL), (3, EXPONENTIAL), (2, OGDEN)])
def test_the_tangent_is_the_derivative_of_the_residual(dim, law):
    body = replace(block(dim), law=law)
    x, direction = body.state(0.02), body.state(0.2, seed=2)
    slope = slope_of(lambda y: forms.residual.assemble(body.basis, **body.at(y)), x, direction, 1e-5)
    tangent = forms.tangent.assemble(body.basis, **body.at(x))
    assert abs(tangent - tangent.T).max() < 1e-9 * abs(tangent).max()
    np.testing.assert_allclose(slope, tangent @ direction, atol=1e-7 * np.abs(slope).max())


def test_plane_strain_is_the_solid_that_cannot_widen():
    gradient = np.array([[0.05, 0.2], [-0.1, -0.15]])
    energies = []
    for body in map(block, (2, 3)):
        body = replace(body, mu=0 * body.mu + 4, bulk=0 * body.mu + 150, stiffening=0 * body.mu + 3)
        u, q = body.basis.split_bases()
        x = np.zeros(body.basis.N)
        moved, pressed = body.basis.split_indices()
        shift = np.zeros((len(body.mesh.doflocs), u.N // len(body.mesh.doflocs)))
        shift[:2] = gradient @ body.mesh.doflocs[:2]
        x[moved] = shift.T.ravel()
        J = np.linalg.det(np.eye(2) + gradient)
        x[pressed] = q.project(150.0 * (J - 1) + 0 * body.basis.dx)
        energies.append(forms.energy.assemble(body.basis, **body.at(x)) / body.basis.dx.sum())
    assert energies[0] == pytest.approx(energies[1], rel=1e-12)


def face(s):
    """An arc of different radius along each horizontal coordinate."""
    f, slope, bend = np.zeros_like(s[0]), np.zeros_like(s), np.zeros((len(s), *s.shape))
    for i, radius in zip([0, 2][: len(s) - 1], (5.0, 9.0)):
        f += s[i] ** 2 / 2 / radius
        slope[i] = s[i] / radius
        bend[i, i] = 1 / radius
    return f, slope, bend


def contact(body, u, pressure, friction=0.0, height=-0.1):
    surface = body.surface
    return forms.face_fields(
        surface.global_coordinates(), surface.interpolate(u), body.shares.interpolate(pressure),
        height, 0.3, face, friction,
    )  # fmt: skip


@pytest.mark.parametrize("dim", [2, 3])
def test_the_contacts_forms_are_derivatives_of_multiplier_times_gap(dim):
    body = block(dim)
    rng = np.random.default_rng(3)
    u, du = rng.normal(0, 0.1, (2, body.surface.N))
    pressure = rng.normal(2, 1, body.shares.N)

    def work(v):
        return pressure @ forms.contact_gap.assemble(body.shares, **contact(body, v, pressure))

    exact = forms.contact_residual.assemble(body.surface, **contact(body, u, pressure)) @ du
    assert slope_of(work, u, du) == pytest.approx(exact, rel=1e-9)
    w = contact(body, u, pressure)
    approach = forms.contact_approach.assemble(body.surface, body.shares, **w)
    traction = forms.contact_traction.assemble(body.shares, body.surface, **w)
    assert abs(approach - traction.T).max() < 1e-14
    gap = slope_of(lambda v: forms.contact_gap.assemble(body.shares, **contact(body, v, pressure)), u, du)
    np.testing.assert_allclose(approach @ du, gap, atol=1e-9)
    higher, lower = (
        forms.contact_gap.assemble(body.shares, **contact(body, u, pressure, height=h)) for h in (0.5, -0.5)
    )
    np.testing.assert_allclose(lower - higher, forms.surface_share.assemble(body.shares), atol=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("dim", [2, 3])
def test_the_contacts_tangent_is_the_derivative_of_its_forces(dim, friction):
    body = block(dim)
    rng = np.random.default_rng(4)
    u, du = rng.normal(0, 0.1, (2, body.surface.N))
    pressure = rng.normal(2, 1, body.shares.N)

    def forces(v):
        return forms.contact_residual.assemble(body.surface, **contact(body, v, pressure, friction))

    tangent = forms.contact_tangent.assemble(body.surface, **contact(body, u, pressure, friction))
    np.testing.assert_allclose(tangent @ du, slope_of(forces, u, du), atol=1e-9)
