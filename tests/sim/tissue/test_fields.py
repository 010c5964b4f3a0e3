"""Fields in the tissue: right where the answer is known."""

from dataclasses import replace

import numpy as np

from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.fields import _Projector
from palpate.sim.tissue.geometry import geometry_of
from palpate.sim.tissue.run import StrokeRun

CASE = Case.from_code("d10h08e10f10")
COARSE = Settings(hx_mm=4.0, increment_mm=4.0, start_mm=-8.0)


def test_an_even_deformation_has_the_same_fields_everywhere():
    case = replace(CASE, fat_stiffening=6.0)
    run = StrokeRun(case, COARSE, geometry_of(case, COARSE, -8.0, 0.0))
    gradient = np.array([[0.05, 0.12], [-0.03, -0.02]])
    state = run._unloaded(0.0)
    state.u[:] = (run.mesh.nodes_mm @ gradient.T).ravel()
    fields = _Projector(run)(run, 0.0, state)
    F = np.eye(2) + gradient
    green = (F.T @ F - np.eye(2)) / 2
    wide, narrow = np.sqrt(np.linalg.eigvalsh(F.T @ F))[::-1]
    expected = {
        "strain": [green[0, 0], green[1, 1], 0, green[0, 1], 0, 0],
        "stretch_1": wide,
        "stretch_2": narrow,
        "volume_ratio": np.linalg.det(F),
    }
    for name, value in expected.items():
        np.testing.assert_allclose(
            fields.values[name], np.broadcast_to(value, fields.values[name].shape), atol=1e-10
        )
    # The mean of Cauchy's normal stresses, from the energy's derivative by F in three dimensions.
    in_fat = np.unique(fields.cells[fields.material == 0])
    mu, bulk, b = run.tissue.constants.mu.min(), run.tissue.constants.bulk.min(), 6.0
    solid = np.eye(3)
    solid[:2, :2] = F

    def energy(F):
        J = np.linalg.det(F)
        return mu / 2 / b * np.expm1(b * ((F * F).sum() - 1 - 2 * J)) + bulk / 2 * (J - 1) ** 2

    step = 1e-4
    units = step * np.eye(9).reshape(9, 3, 3)
    P = np.array([(energy(solid + e) - energy(solid - e)) / (2 * step) for e in units]).reshape(3, 3)
    pressure = -np.trace(P @ solid.T) / np.linalg.det(F) / 3
    np.testing.assert_allclose(fields.values["pressure_kPa"][in_fat], pressure, rtol=1e-5)
