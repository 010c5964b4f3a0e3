"""Presses that others have published: files made in their layouts, with known answers."""

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from palpate import open_recording
from palpate.cli import main as cli
from palpate.errors import NoSuchFile, UsageError
from palpate.importing.less import read_less
from palpate.importing.presses import read_mat
from palpate.inversion.recorded import felt_strokes
from palpate.wire.events import Frame
from tests.studies.real_data import exponent, main, repeatability, strength_and_unevenness, told_apart

DEPTH_MM = np.arange(0, 20.5, 0.5)
EXPONENT = 0.5
LUMPS = {(1, 2): 4, (4, 4): 2, (2, 1): 1, (3, 3): 3}


@pytest.fixture
def phantom(tmp_path):
    """Sixteen places, three repeats; over a lump half of the taxels feel more; one repeat is no press."""
    told, kinds = {}, np.full((4, 4, 3), 5, np.int16)
    for row in range(1, 5):
        for column in range(1, 5):
            kinds[row - 1, column - 1, 0] = LUMPS.get((row, column), 5)
            felt = 1000 * DEPTH_MM[:, None, None] ** EXPONENT * np.ones((1, 10, 3)) * [1.0, 1.0, 1.02]
            felt[:, :5] *= 1.3 if (row, column) in LUMPS else 1.0
            if (row, column) == (4, 3):
                felt[..., 0] *= 0.01
            depth = np.broadcast_to(DEPTH_MM[:, None, None], (41, 1, 3))
            told[f"Vertical_{row}_{column}"] = np.concatenate([depth, 10_000 + felt], axis=1)
    told["nodules"] = kinds
    savemat(tmp_path / "phantom.mat", told)
    return tmp_path / "phantom.mat", told


def test_repeats_law_and_lumps_are_found_as_they_were_made(phantom, capsys):
    found = read_mat(phantom[0])
    assert found.rise.shape == (16, 41, 10, 3) and found.broken == [((4, 3), 1)]
    assert repeatability(found) == pytest.approx(0.02 / 1.01, rel=1e-6)
    assert exponent(found, 1, 20) == pytest.approx((EXPONENT,) * 3, abs=1e-9)
    assert [told_apart(found, score) for score in strength_and_unevenness(found, 20)] == [1.0, 1.0]
    main(phantom[0])
    assert "place 4-3, repeat 1: not a whole press" in capsys.readouterr().out


def test_what_is_no_file_of_presses_gets_one_sentence(phantom, tmp_path):
    path, told = phantom
    with pytest.raises(NoSuchFile, match="no file of presses"):
        read_mat(tmp_path / "nothing.mat")
    for change in ({"nodules": np.zeros((4, 4, 3))}, {"Vertical_1_1": np.zeros((41, 11, 3))}):
        savemat(path, told | change)
        with pytest.raises(UsageError, match="does not hold presses"):
            read_mat(path)
    path.write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    with pytest.raises(UsageError, match="does not hold presses"):
        read_mat(path)


def less(path):
    """A file of that layout: 16 taxels that go 20 mm in x and 40 in y each second."""
    time = np.linspace(0, 2, 40)
    robot = np.linspace(-0.1, 2.1, 23)
    with h5py.File(path, "w") as file:
        for name, samples in (("traj_10", 40), ("traj_2", 40), ("traj_3", 4)):
            group = file.create_group(name)
            group["xela/data"] = np.full((samples, 16, 3), float(name.removeprefix("traj_")))
            group["xela/timestamps"] = time[:samples]
            group["robot/ee_position"] = 0.02 * np.column_stack([robot, 2 * robot, 0 * robot])
            group["robot/ee_rotation"] = np.tile(np.eye(3), (23, 1, 1))
            group["robot/timestamps"] = robot
    return time


def test_a_file_of_less_gives_taxels_at_their_places(tmp_path):
    time = less(tmp_path / "S1_St8C13_0.hdf5")
    found = read_less(tmp_path / "S1_St8C13_0.hdf5")
    assert [each.name for each in found] == ["traj_2", "traj_10"]
    assert found[1].felt.shape == (40, 16, 3) and (found[1].felt == 10).all()
    assert found[0].position == pytest.approx(0.02 * np.column_stack([time, 2 * time, 0 * time]), abs=1e-12)


DECLARED = """
rows = {rows}
columns = {columns}
pitch_mm = 4.7
{rest}
[pressure]
name = "{pressure}"
unit = "counts"
kPa_per_unit = {kPa}
[displacement]
name = "depth_mm"
[position]
name = "{position}"
[stroke]
name = "{stroke}"
"""


def imported(tmp_path, capsys, file, **words):
    """What `palpate import` says of a file so declared."""
    (tmp_path / "sensor.toml").write_text(DECLARED.format(**words))
    arguments = ["import", str(file), "--as", str(tmp_path / "sensor.toml"), "--out", str(tmp_path / "out")]
    assert cli(arguments) == 0, capsys.readouterr().err
    said = capsys.readouterr()
    return said.out + said.err


def test_presses_are_imported_by_the_names_of_their_layout(phantom, tmp_path, capsys):
    assert cli(["import", str(phantom[0]), "--out", str(tmp_path)]) == 2
    assert "[pressure] taxels, [displacement] depth_mm, [position] still_mm" in capsys.readouterr().err
    said = imported(
        tmp_path, capsys, phantom[0], rows=2, columns=5, pressure="taxels", kPa=0.004, position="still_mm",
        stroke="press", rest="frames_per_s = 20",
    )  # fmt: skip
    assert f"0 strokes, {47 * 41} frames" in said and "47 presses and no stroke" in said
    with open_recording(tmp_path / "out" / "phantom.mcap") as session:
        frames = [event for event in session.events() if isinstance(event, Frame)]
    assert max(frame.displacement_mm for frame in frames) == 20.0
    (felt, _), *_ = felt_strokes(tmp_path / "out" / "phantom.mcap")
    assert felt.alone and felt.measured and felt.displacement_mm[-1] == pytest.approx(20.0, abs=0.5)


def test_trajectories_of_less_are_imported_as_strokes(tmp_path, capsys):
    less(tmp_path / "phantom.hdf5")
    said = imported(
        tmp_path, capsys, tmp_path / "phantom.hdf5", rows=4, columns=4, pressure="normal", kPa=0.5,
        position="along_mm", stroke="trajectory", rest='[time]\nname = "time_s"',
    )  # fmt: skip
    assert "4 x 4 cells at 4.7 mm were resampled" in said
    with open_recording(tmp_path / "out" / "phantom.mcap") as session:
        places = [event.position_mm for event in session.events() if isinstance(event, Frame)]
    assert np.ptp(places) == pytest.approx(40 * np.sqrt(5), rel=0.03)


def test_what_is_not_of_less_gets_one_sentence(tmp_path):
    with pytest.raises(NoSuchFile, match="there is no file"):
        read_less(tmp_path / "nothing.hdf5")
    (tmp_path / "text.hdf5").write_text("no HDF5")
    with pytest.raises(UsageError, match="is not of LESS' layout"):
        read_less(tmp_path / "text.hdf5")
    with h5py.File(tmp_path / "other.hdf5", "w") as file:
        file.create_group("traj_1/xela")
    with pytest.raises(UsageError, match="is not of LESS' layout"):
        read_less(tmp_path / "other.hdf5")
