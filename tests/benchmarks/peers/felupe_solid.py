"""The stroke over a ball in felupe: hexahedra with constant pressure, nodal penalty contact, CHOLMOD.

Units: mm, kPa, mN.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import felupe
import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.face_sensors import ACROSS, SENSORS_MM, places_mm
from palpate.sim.tissue.probe_shape import ProbeShape
from palpate.sim.tissue.solid.element import elasticity, integrate
from palpate.sim.tissue.solid.face import FaceShape, Profile
from palpate.sim.tissue.solid.grid import lay_grid
from palpate.sim.tissue.solid.mesh import LATTICE_OF_LOCAL, build_mesh
from tests.benchmarks.peers import Peer
from tests.benchmarks.peers.felupe_sliding import PenaltyContact, Sliding

_LOWERED_MM = 0.4
_CORNER = np.array([0, 1, 4, 3, 9, 10, 13, 12])
EIGHTHS = np.array([a + 3 * b + 9 * c + _CORNER for c in (0, 1) for b in (0, 1) for a in (0, 1)])
"""Nodes of the eight-node cells that a 27-node element's lattice is cut into."""


def run(case: Case, settings: Settings, positions_mm: Sequence[float]) -> Peer:
    """Simulate the stroke over a lump on the line, on our half mesh with every element cut into eight."""
    began = time.process_time()
    grid = lay_grid(case, settings, positions_mm[0], positions_mm[-1])
    mesh = build_mesh(grid)
    integrals = integrate(mesh)
    constants = elasticity(case, mesh, integrals)
    mu = constants.mu_dx.sum(1) / integrals.volume
    lattice = np.empty_like(mesh.elements)
    lattice[:, LATTICE_OF_LOCAL] = mesh.elements
    points = np.vstack([mesh.nodes_mm, [[0.0, case.centre_mm, 0.0]]])
    cells = felupe.Mesh(points, lattice[:, EIGHTHS].reshape(-1, 8), "hexahedron")
    field = felupe.FieldContainer([felupe.Field(felupe.RegionHexahedron(cells), dim=3)])
    material = felupe.NeoHooke(mu=np.repeat(mu, 8))
    material.chunksize = None  # moduli for each cell do not go with chunks of cells
    body = felupe.SolidBodyNearlyIncompressible(material, field, bulk=np.repeat(constants.bulk - mu / 3, 8))

    face = FaceShape(
        ProbeShape(case.probe_radius_mm, case.face_half_mm, case.fillet_per_mm2),
        ProbeShape(case.across_radius_mm, case.across_half_mm, case.across_fillet_per_mm2),
    )
    nodes = mesh.surface.ravel()
    skin = mesh.nodes_mm[nodes]
    rest = skin.reshape(*mesh.surface.shape, 3)
    contact = PenaltyContact(
        nodes,
        skin,
        _areas(rest[..., 0], rest[..., 2]).ravel(),
        field[0].values,
        lambda places: face.height(places[:, 0], places[:, 1]),
    )
    stroke = Sliding(field, body, contact, mesh.fixed, 500.0 * case.F_N)  # half of the force
    stroke.press(positions_mm[0], _LOWERED_MM)
    displacement, images = [], []
    for here, position in zip([positions_mm[0], *positions_mm], positions_mm):
        if position > here:
            stroke.move(here, position)
        now = (skin + stroke.values[nodes]).reshape(rest.shape)
        pull = np.maximum(contact.forces(contact.look(position)[0]), 0.0).reshape(mesh.surface.shape)
        x, z = now[..., 0], now[..., 2]
        pressure = pull / _areas(x, z)
        profile = Profile(rest[:, 0, 0], rest[0, :, 2], x, z, pressure, pressure**2, pull.sum())
        displacement.append(stroke.depth_mm)
        images.append(profile.read(position, SENSORS_MM, places_mm(ACROSS), True))
    spent = time.process_time() - began
    return Peer(
        "felupe Q1P0", len(points), spent, np.array(displacement), np.array(images), stroke.iterations
    )


def _areas(x: NDArray, z: NDArray) -> NDArray:
    """The skin that belongs to each node of a lattice (n, m), seen from above."""
    dx, dz = np.gradient(x, axis=0), np.gradient(z, axis=1)
    dx[[0, -1]] /= 2
    dz[:, [0, -1]] /= 2
    return np.asarray(dx * dz)
