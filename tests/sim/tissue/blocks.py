"""Plain blocks of tissue, to test the element and the contact where the answer is known."""

from __future__ import annotations

import numpy as np

from palpate.sim.tissue.contact import Contact
from palpate.sim.tissue.element import integrate
from palpate.sim.tissue.material import Elasticity, Tissue
from palpate.sim.tissue.mesh import FAT, TissueMesh, cells_of, mesh_of
from palpate.sim.tissue.newton import Newton
from palpate.sim.tissue.probe_shape import ProbeShape
from palpate.sim.tissue.solver.choice import make_solver
from palpate.sim.tissue.state import State


def block(x, y, shake=0.0, seed=0, rollers=True) -> TissueMesh:
    """A rectangle on the grid `x` by `y`, fixed below; inner corners moved by up to `shake` mm."""
    corners = np.stack(np.meshgrid(np.asarray(x, float), np.asarray(y, float), indexing="ij"), -1)
    noise = np.random.default_rng(seed).uniform(-shake, shake, corners[1:-1, 1:-1].shape)
    corners[1:-1, 1:-1] += noise
    nx, ny = len(x) - 1, len(y) - 1
    ids = np.arange((nx + 1) * (ny + 1)).reshape(nx + 1, ny + 1)
    mesh = mesh_of(
        corners.reshape(-1, 2),
        cells_of(ids).reshape(-1, 4),
        material=np.full(nx * ny, FAT),
        column=np.repeat(np.arange(nx), ny),
        element_rows=np.arange(nx * ny).reshape(nx, ny).T.copy(),
    )
    if not rollers:
        mesh.fixed[mesh.nodes_mm[:, 1] > mesh.nodes_mm[:, 1].min()] = False
    return mesh


def tissue_of(mesh: TissueMesh, young_kPa=10.0, nu=0.495, stiffening=0.0, law=0) -> Tissue:
    """One material throughout."""
    n = len(mesh.elements)
    mu = young_kPa / 2 / (1 + nu)
    bulk = young_kPa * nu / ((1 + nu) * (1 - 2 * nu)) + mu
    constants = Elasticity(np.full(n, mu), np.full(n, bulk), np.full(n, stiffening), law)
    return Tissue(mesh, integrate(mesh), constants)


def press(tissue: Tissue, shape: ProbeShape, force: float, depth: float, tolerance=1e-9, augmentation=1e6):
    """Press in the middle: places (S,), pressures (S,), state."""
    mesh = tissue.mesh
    contact = Contact(mesh, shape, 0.0, augmentation)
    newton = Newton(tissue, contact, make_solver("strip", mesh, precise=True), tolerance)
    top = mesh.nodes_mm[mesh.surface[0], 1]
    zero = np.zeros(2 * len(mesh.nodes_mm))
    start = State(zero, top - depth, np.zeros(len(mesh.surface)), np.zeros((len(mesh.elements), 3)))
    state = newton.solve(start, 0.0, force, limit=40)
    x, pressure, _ = contact.pressure(state.u, state.multiplier, 0.0)
    return x, pressure, state
