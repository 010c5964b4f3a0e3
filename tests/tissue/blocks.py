"""Plain blocks of tissue, to test the element and the contact where the answer is known."""

from __future__ import annotations

import numpy as np

from sim.tissue.contact import Contact
from sim.tissue.element import integrate
from sim.tissue.material import Elasticity, Tissue
from sim.tissue.mesh import FAT, TissueMesh, _cells, _lattice
from sim.tissue.newton import Newton
from sim.tissue.predictor import State
from sim.tissue.probe_shape import ProbeShape
from sim.tissue.solvers import make_solver


def block(x, y, shake=0.0, seed=0, rollers=True) -> TissueMesh:
    """A rectangle on the grid `x` by `y`, fixed below; inner corners moved by up to `shake` mm."""
    corners = np.stack(np.meshgrid(np.asarray(x, float), np.asarray(y, float), indexing="ij"), -1)
    noise = np.random.default_rng(seed).uniform(-shake, shake, corners[1:-1, 1:-1].shape)
    corners[1:-1, 1:-1] += noise
    nodes = _lattice(corners)
    ids = np.arange(nodes[..., 0].size).reshape(nodes.shape[:2])
    fixed = np.zeros((ids.size, 2), bool)
    fixed[ids[:, 0]] = True
    if rollers:
        fixed[ids[[0, -1]], 0] = True
    nx, ny = len(x) - 1, len(y) - 1
    return TissueMesh(
        nodes_mm=nodes.reshape(-1, 2),
        elements=_cells(ids).reshape(-1, 9),
        material=np.full(nx * ny, FAT),
        column=np.repeat(np.arange(nx), ny),
        surface=ids[:, -1].copy(),
        node_rows=ids.T.copy(),
        element_rows=np.arange(nx * ny).reshape(nx, ny).T.copy(),
        fixed=fixed,
        grid=None,  # type: ignore[arg-type]
    )


def tissue_of(mesh: TissueMesh, young_kPa=10.0, nu=0.495, stiffening=0.0) -> Tissue:
    """One material throughout."""
    n = len(mesh.elements)
    mu = young_kPa / 2 / (1 + nu)
    bulk = young_kPa * nu / ((1 + nu) * (1 - 2 * nu)) + mu
    return Tissue(mesh, integrate(mesh), Elasticity(np.full(n, mu), np.full(n, bulk), np.full(n, stiffening)))


def press(tissue: Tissue, shape: ProbeShape, force: float, depth: float, tolerance=1e-9, augmentation=1e6):
    """Press in the middle: places (S,), pressures (S,), state."""
    mesh = tissue.mesh
    contact = Contact(mesh, shape, 0.0, augmentation)
    newton = Newton(tissue, contact, make_solver("strip", mesh), tolerance)
    top = mesh.nodes_mm[mesh.surface[0], 1]
    zero = np.zeros(2 * len(mesh.nodes_mm))
    start = State(zero, top - depth, np.zeros(len(mesh.surface)), np.zeros((len(mesh.elements), 3)))
    state = newton.solve(start, 0.0, force, limit=40)
    x, pressure, _ = contact.pressure(state.u, state.multiplier)
    return x, pressure, state
