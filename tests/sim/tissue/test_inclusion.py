"""A bonded lump under shear from far away has an exact answer, which tests the lump's mesh without contact.

Goodier 1933 and Eshelby 1957: the strain inside is even, 1 / (1 + beta (r - 1)) of that far away, with r the
lump's stiffness over its surroundings'. beta is (3 - 4 nu) / (4 (1 - nu)) for a cylinder and
2 (4 - 5 nu) / (15 (1 - nu)) for a ball: 2 / (1 + r) and 5 / (3 + 2 r) where nothing is compressible.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.element import integrate
from palpate.sim.tissue.material import Tissue, elasticity
from palpate.sim.tissue.mesh import LUMP, build_mesh
from palpate.sim.tissue.solid import element as solid_element
from palpate.sim.tissue.solid import mesh as solid_mesh
from palpate.sim.tissue.solid.body import Body
from palpate.sim.tissue.solid.fronts import lay_fronts
from palpate.sim.tissue.solid.grid import lay_grid
from palpate.sim.tissue.solid.multifrontal import Multifrontal

STRAIN = 1e-6


def inside(case: Case, settings: Settings) -> np.ndarray:
    """Strain of the lump over Goodier's, (elements, 9), and each place's share of the lump."""
    mesh = build_mesh(case, settings, -28.0, 28.0)
    tissue = Tissue(mesh, integrate(mesh), elasticity(case, mesh))
    m, size = len(mesh.elements), mesh.nodes_mm.size
    K, u = np.empty((m, 18, 18)), np.zeros(size)
    tissue.tangent(u, np.zeros((m, 3)), np.arange(m), K, np.empty((m, 3, 18)))
    dofs = np.concatenate([2 * mesh.elements, 2 * mesh.elements + 1], 1)
    rows, columns = np.repeat(dofs, 18, 1).ravel(), np.tile(dofs, 18).ravel()
    whole = coo_array((K.ravel(), (rows, columns)), shape=(size, size)).tocsr()
    ends = mesh.nodes_mm.min(0), mesh.nodes_mm.max(0)
    held = np.repeat((mesh.nodes_mm <= ends[0]).any(1) | (mesh.nodes_mm >= ends[1]).any(1), 2)
    u[:] = (mesh.nodes_mm * [STRAIN, -STRAIN]).ravel()
    u[~held] = spsolve(whole[~held][:, ~held], -whole[~held][:, held] @ u[held])
    lump = mesh.material == LUMP
    strain = np.einsum("eqca,eac->eqc", tissue.integrals.dN, u.reshape(-1, 2)[mesh.elements])[lump, :, 0]
    beta = (3 - 4 * case.poisson) / (4 * (1 - case.poisson))
    share = tissue.integrals.dx[lump] / tissue.integrals.dx[lump].sum()
    return np.stack([strain / STRAIN * (1 + beta * (case.E_ratio - 1)), share])


@pytest.mark.parametrize("nu", [0.3, 0.495])
@pytest.mark.parametrize("r", [0.2, 10.0, 1000.0])
def test_a_cylinder_is_strained_as_goodier_says(r, nu):
    """Of the last percent .7 are the block's ends, 85 mm away; finer elements show it."""
    case = Case(10.0, 8.0, r, gland_ratio=1.0, gland_mm=100.0, poisson=nu)
    strain, share = inside(case, Settings())
    assert (strain * share).sum() == pytest.approx(1.0, rel=0.015)
    spread = np.sqrt(((strain - 1) ** 2 * share).sum())
    if (r, nu) == (10.0, 0.495):
        finer, finer_share = inside(case, Settings(refine=2))
        assert (finer * finer_share).sum() == pytest.approx(1.0, rel=0.01)
        assert np.sqrt(((finer - 1) ** 2 * finer_share).sum()) < 0.6 * spread


def inside_ball(case: Case) -> np.ndarray:
    """As `inside` of a ball: half of it, (elements, 27)."""
    mesh = solid_mesh.build_mesh(lay_grid(case, Settings(), 0.0, 0.0))
    x = mesh.nodes_mm
    outside = (x <= x.min(0)) | (x >= x.max(0))
    outside[:, 2] = x[:, 2] >= x[:, 2].max()
    held = outside.any(1)[:, None] | (np.arange(3) == 2) & (x[:, 2:] <= 0.0)
    mesh = replace(mesh, fixed=held)
    integrals = solid_element.integrate(mesh)
    body = Body(mesh, integrals, solid_element.elasticity(case, mesh, integrals))
    m = len(mesh.elements)
    K = np.zeros((m, 81, 81))
    body.tangent(np.zeros(x.size), np.zeros((m, 4)), np.arange(m), K, np.zeros((m, 4, 81)))
    upper = np.triu(K)
    whole = upper + np.triu(upper, 1).transpose(0, 2, 1)
    solver = Multifrontal(lay_fronts(mesh))
    solver.change_elements(np.arange(m))
    solver.factor(lambda which, into: np.copyto(into, K[which]))
    u = x * [STRAIN, -STRAIN, 0.0]
    for _ in range(3):  # the factor has single precision
        forces = np.zeros_like(u)
        product = np.einsum("eij,ej->ei", whole, u[mesh.elements].reshape(m, 81)).reshape(m, 27, 3)
        np.add.at(forces, mesh.elements, product)
        forces[held] = 0.0
        u -= solver.solve(forces.reshape(1, -1))[0].reshape(-1, 3)
    lump = mesh.lump
    strain = np.einsum("eap,ea->ep", integrals.dN[integrals.shape[lump], 0], u[mesh.elements[lump], 0])
    beta = 2 * (4 - 5 * case.poisson) / (15 * (1 - case.poisson))
    share = integrals.dx[lump] / integrals.dx[lump].sum()
    return np.stack([strain / STRAIN * (1 + beta * (case.E_ratio - 1)), share])


@pytest.mark.parametrize("r", [10.0, *(pytest.param(r, marks=pytest.mark.long) for r in (0.2, 1000.0))])
def test_a_ball_is_strained_as_goodier_says(r):
    strain, share = inside_ball(Case(10.0, 4.0, r, gland_ratio=1.0, gland_mm=50.0, shape="ball"))
    assert (strain * share).sum() == pytest.approx(1.0, rel=0.01)
    assert np.sqrt(((strain - 1) ** 2 * share).sum()) < 0.05
