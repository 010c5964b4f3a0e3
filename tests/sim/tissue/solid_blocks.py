"""Plain blocks of tissue in space, to test the element and the contact where the answer is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from skfem import MeshHex2

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.probe_shape import ProbeShape
from palpate.sim.tissue.solid.body import Body
from palpate.sim.tissue.solid.element import elasticity, integrate
from palpate.sim.tissue.solid.face import FaceContact, FaceShape
from palpate.sim.tissue.solid.fronts import lay_fronts
from palpate.sim.tissue.solid.grid import SolidGrid
from palpate.sim.tissue.solid.mesh import SolidMesh, build_mesh
from palpate.sim.tissue.solid.multifrontal import Multifrontal
from palpate.sim.tissue.solid.newton import SolidNewton
from palpate.sim.tissue.state import State

FLAT = FaceShape(ProbeShape(math.inf, 1e6, 1.0), ProbeShape(math.inf, 1e6, 1.0))


def block(x, y, z, shake=0.0, seed=0) -> SolidMesh:
    """A cuboid on a grid, fixed below and on rollers at its sides; what is inside is moved by up to `shake`
    mm."""
    x, y, z = (np.asarray(v, float) for v in (x, y, z))
    mesh = build_mesh(SolidGrid(x, y, z, None, (1.0, 1.0, 1.0), 0.0, (-math.inf,), 0.0, 0, 0, False))
    if not shake:
        return mesh
    nodes = mesh.nodes_mm.copy()
    inside = ((nodes > nodes.min(0) + 1e-9) & (nodes < nodes.max(0) - 1e-9)).all(1)
    nodes[inside] += np.random.default_rng(seed).uniform(-shake, shake, (inside.sum(), 3))
    return replace(mesh, nodes_mm=nodes, fem=MeshHex2(np.ascontiguousarray(nodes.T), mesh.fem.t))


def body_of(mesh: SolidMesh, young_kPa=10.0, nu=0.495, stiffening=0.0) -> Body:
    """One material throughout."""
    case = Case(10, 0.8, 1.0, fat_kPa=young_kPa, poisson=nu, fat_stiffening=stiffening, shape="ball")
    integrals = integrate(mesh)
    return Body(mesh, integrals, elasticity(case, mesh, integrals))


def press(body: Body, shape: FaceShape, force: float, depth: float, tolerance=1e-6, augmentation=1e4):
    """Press in the middle: what the contact reads of the skin, and the state."""
    mesh = body.mesh
    contact = FaceContact(mesh, shape, augmentation)
    newton = SolidNewton(body, contact, Multifrontal(lay_fronts(mesh)), tolerance)
    zero = np.zeros(3 * len(mesh.nodes_mm))
    start = State(zero, contact.y0[0] - depth, np.zeros(mesh.surface.size), np.zeros((len(mesh.elements), 4)))
    state = newton.solve(start, 0.0, force, limit=60)
    return contact.pressure(state.u, state.multiplier), state
