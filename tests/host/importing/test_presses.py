"""Presses that others have published: files made in their layouts, with known answers."""

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from palpate.errors import NoSuchFile, UsageError
from palpate.importing.less import read_less
from palpate.importing.presses import read_mat
from tests.studies.real_data import main

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
    assert found.repeatability() == pytest.approx(0.02 / 1.01, rel=1e-6)
    assert found.exponent(1, 20) == pytest.approx((EXPONENT,) * 3, abs=1e-9)
    assert found.told_apart(found.unevenness(20)) == found.told_apart(found.strength(20)) == 1.0
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


def test_a_file_of_less_gives_taxels_at_their_places(tmp_path):
    time = np.linspace(0, 2, 40)
    robot = np.linspace(-0.1, 2.1, 23)
    with h5py.File(tmp_path / "S1_St8C13_0.hdf5", "w") as file:
        for name, samples in (("traj_10", 40), ("traj_2", 40), ("traj_3", 4)):
            group = file.create_group(name)
            group["xela/data"] = np.full((samples, 16, 3), float(name.removeprefix("traj_")))
            group["xela/timestamps"] = time[:samples]
            group["robot/ee_position"] = np.column_stack([robot, 2 * robot, 0 * robot])
            group["robot/ee_rotation"] = np.tile(np.eye(3), (23, 1, 1))
            group["robot/timestamps"] = robot
    found = read_less(tmp_path / "S1_St8C13_0.hdf5")
    assert [each.name for each in found] == ["traj_2", "traj_10"]
    assert found[1].felt.shape == (40, 16, 3) and (found[1].felt == 10).all()
    assert found[0].position == pytest.approx(np.column_stack([time, 2 * time, 0 * time]), abs=1e-12)


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
