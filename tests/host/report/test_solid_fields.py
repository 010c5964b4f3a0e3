"""What ParaView is given of the tissue round a ball reads back."""

import meshio
import numpy as np
import pytest

from palpate.report.tissue_fields import write_fields
from palpate.sim.tissue import Case, Settings, simulate_fields


def test_the_fields_round_a_ball_are_those_of_the_stroke(tmp_path):
    case = Case.from_code("d10h06e10f06_ball")
    stroke, series = simulate_fields(case, Settings(hx_mm=4.0), [0.0])
    write_fields(tmp_path / "ball.vtu", series)
    mesh = meshio.read(tmp_path / "ball.vtu")
    cells, data = mesh.cells_dict["hexahedron27"], mesh.point_data
    assert set(mesh.cell_data["material"][0]) == {0, 1, 2}
    # VTK's order: the first four corners are the lower face, the ninth node the middle of its first side, the
    # last the middle of all.
    corners = mesh.points[cells[:, :8]]
    edges = corners[:, [1, 3, 4]] - corners[:, [0]]
    assert (np.linalg.det(edges) > 0).all()
    assert np.abs(corners[:, :2].mean(1) - mesh.points[cells[:, 8]]).max() < 1.5
    assert np.abs(corners.mean(1) - mesh.points[cells[:, 26]]).max() < 1.5
    # What touches lies on the face.
    now = (mesh.points + data["displacement_mm"])[data["contact_pressure_kPa"] > 0]
    inner = (np.abs(now[:, 0]) < 10) & (np.abs(now[:, 2]) < 17)
    face = now[:, 1] - now[:, 0] ** 2 / 80 - now[:, 2] ** 2 / 400
    np.testing.assert_allclose(face[inner], case.centre_mm - stroke.displacement_mm[0], atol=1e-3)
    product = data["stretch_1"] * data["stretch_2"] * data["stretch_3"]
    np.testing.assert_allclose(product, data["volume_ratio"], rtol=0.1)
    assert data["pressure_kPa"].max() == pytest.approx(stroke.peak_kPa[0], rel=0.6)
    assert data["strain"].shape == (len(mesh.points), 6)


def test_pictures_of_fields_are_of_cylinders(tmp_path, palpate):
    status, _, err = palpate("simulate", "d10h06e10f06_ball", "--fields", tmp_path / "ball.png")
    assert status == 2 and ".vtu" in err
