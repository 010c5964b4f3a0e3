"""What ParaView is given of the tissue reads back, at every position."""

import xml.etree.ElementTree as xml

import meshio
import numpy as np
import pytest

from palpate.report.tissue_fields import draw_fields, write_fields
from palpate.sim.tissue import Case, Settings, simulate_fields

CASE = Case.from_code("d10h08e10f10")
COARSE = Settings(hx_mm=4.0, increment_mm=4.0, start_mm=-8.0)


def test_paraviews_files_hold_every_position(tmp_path, palpate):
    out = tmp_path / "tissue.vtu"
    steps = ("--hx", "4", "--increment", "4", "--start", "-8")
    status, _, err = palpate("simulate", CASE.code, *steps, "--fields", out)
    assert status == 0 and "3 positions" in err
    stroke, _ = simulate_fields(CASE, COARSE)
    entries = xml.parse(out.with_suffix(".pvd")).getroot().findall("Collection/DataSet")
    assert [float(entry.get("timestep")) for entry in entries] == stroke.positions_mm.tolist()
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        ["tissue.pvd", "tissue.vtu", *(entry.get("file") for entry in entries)]
    )
    for i, entry in enumerate(entries):
        mesh = meshio.read(tmp_path / entry.get("file"))
        data = mesh.point_data
        quads = mesh.cells_dict["quad9"]
        assert set(mesh.cell_data["material"][0]) == {0, 1, 2}
        # Elements are anticlockwise and their fifth node is the middle of the first side: VTK's order.
        corners = mesh.points[quads[:, :4], :2]
        along, up = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
        assert (along[:, 0] * up[:, 1] - along[:, 1] * up[:, 0] > 0).all()
        straight = mesh.points[quads[:, :2]].mean(1) - mesh.points[quads[:, 4]]
        assert np.abs(straight).max() < 0.2
        # What touches the probe lies on its face, whose lowest point the stroke knows.
        touching = data["contact_pressure_kPa"] > 0
        now = (mesh.points + data["displacement_mm"])[touching]
        face = (now[:, 0] - stroke.positions_mm[i]) ** 2 / 2 / CASE.probe_radius_mm
        inner = np.abs(now[:, 0] - stroke.positions_mm[i]) < CASE.face_half_mm
        lowest = CASE.t_mm - stroke.displacement_mm[i]
        np.testing.assert_allclose((now[:, 1] - face)[inner], lowest, atol=1e-3)
        # Under it the tissue bears about the contact's pressure.
        assert data["pressure_kPa"].max() == pytest.approx(stroke.peak_kPa[i], rel=0.5)
        assert (
            data["stretch_1"] - data["stretch_2"]
        ).min() > -0.01  # where both are 1, what projection leaves
        np.testing.assert_allclose(data["stretch_1"] * data["stretch_2"], data["volume_ratio"], rtol=0.05)
        assert data["strain"].shape == (len(mesh.points), 6)
    alone = meshio.read(out)
    for name, values in alone.point_data.items():
        np.testing.assert_array_equal(values, data[name])


def test_a_collection_alone_and_pictures(tmp_path):
    _, series = simulate_fields(CASE, COARSE, [0.0])
    written = write_fields(tmp_path / "stroke.pvd", series)
    assert [path.name for path in written] == ["stroke.pvd", "stroke_000.vtu"]
    figure = draw_fields(series[0], CASE.code)
    titles = [ax.get_title() for ax in figure.axes]
    assert titles[:3] == ["pressure, kPa", "vertical strain", "larger principal stretch"]
    shown = figure.axes[0].collections[0].get_array()
    near = series[0].values["pressure_kPa"]
    assert near.min() <= shown.min() < shown.max() <= 1.1 * near.max()


def test_another_kind_of_file_is_refused_before_the_work(tmp_path, palpate):
    status, _, err = palpate("simulate", CASE.code, "--fields", tmp_path / "tissue.stl")
    assert status == 2 and ".vtu, .pvd, .png, .svg" in err
    assert not list(tmp_path.iterdir())
