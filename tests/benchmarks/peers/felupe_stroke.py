"""The stroke in felupe: Q1 elements with constant pressure, nodal penalty contact. Units: mm, kPa, N/m."""

from __future__ import annotations

import time

import felupe
import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.material import elasticity
from palpate.sim.tissue.mesh import build_mesh
from palpate.sim.tissue.probe_shape import ProbeShape
from palpate.sim.tissue.reading import read_sensors
from tests.benchmarks.peers import QUARTERS, Peer
from tests.benchmarks.peers.felupe_sliding import PenaltyContact, Sliding

_LOWERED_MM = 0.4


def run(case: Case, settings: Settings) -> Peer:
    """Simulate the stroke of `case` on our mesh, every nine-node element cut into four."""
    began = time.process_time()
    positions = [float(x) for x in settings.positions_mm()]
    mesh = build_mesh(case, settings, positions[0], positions[-1])
    constants = elasticity(case, mesh)
    owner = np.repeat(np.arange(len(mesh.elements)), 4)
    points = np.vstack([mesh.nodes_mm, [[0.0, case.t_mm]]])
    quads = felupe.Mesh(points, mesh.elements[:, QUARTERS].reshape(-1, 4), "quad")
    field = felupe.FieldContainer([felupe.FieldPlaneStrain(felupe.RegionQuad(quads), dim=2)])
    material = felupe.NeoHooke(mu=constants.mu[owner])
    material.chunksize = None  # moduli for each cell do not go with chunks of cells
    bulk = (constants.bulk - constants.mu / 3)[owner]
    body = felupe.SolidBodyNearlyIncompressible(material, field, bulk=bulk)

    shape = ProbeShape(case.probe_radius_mm, case.face_half_mm, case.fillet_per_mm2)

    def face(places: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        height, slope, curvature = shape.height(places[:, 0])
        return height, slope[:, None], curvature[:, None]

    skin = mesh.nodes_mm[mesh.surface]
    lengths = np.gradient(skin[:, 0])
    lengths[[0, -1]] /= 2
    contact = PenaltyContact(mesh.surface, skin, lengths, field[0].values, face)
    stroke = Sliding(field, body, contact, mesh.fixed, case.F_N_per_m)
    stroke.press(positions[0], _LOWERED_MM)
    displacement, images = [], []
    for here, position in zip([positions[0], *positions], positions):
        if position > here:
            stroke.move(here, position)
        x = skin[:, 0] + stroke.values[mesh.surface, 0]
        pressure = np.maximum(contact.forces(contact.look(position)[0]), 0.0) / np.gradient(x)
        displacement.append(stroke.depth_mm)
        images.append(read_sensors(x - position, pressure))
    spent = time.process_time() - began
    return Peer(
        "felupe Q1P0", len(points), spent, np.array(displacement), np.array(images), stroke.iterations
    )
