"""Palpations of breast phantoms in the layout of LESS: one HDF5 file a phantom, a group a trajectory.

Each group traj_N has xela/data (samples, taxels, 3) with xela/timestamps, and robot/ee_position (samples, 3)
and robot/ee_rotation (samples, 3, 3) with robot/timestamps. Source: `load_h5_data` of github.com/zoharri/LESS
(real_data_utils.py). Readings stay raw: the files say no unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import MissingExtra, NoSuchFile, UsageError

Floats = NDArray[np.float64]
LEAST = 10
"""Samples of a trajectory; shorter ones are left out, as there."""


@dataclass(frozen=True)
class Trajectory:
    """One palpation, at the times of its taxels.

    Parameters
    ----------
    name : str
    time : (samples,)
    felt : (samples, taxels, 3)
        Along x, y and z of the sensor, raw.
    position : (samples, 3)
        Of the hand that held it, between the robot's samples by straight lines.
    """

    name: str
    time: Floats
    felt: Floats
    position: Floats


def read_less(path: Path) -> list[Trajectory]:
    """The trajectories of a file, in the order of their numbers; those that are too short are left out.

    Raises
    ------
    MissingExtra
        h5py is not installed.
    NoSuchFile, UsageError
        It is not there, or something else.
    """
    try:
        import h5py
    except ImportError:
        raise MissingExtra("h5py", "hdf5", "reading HDF5") from None
    if not path.is_file():
        raise NoSuchFile(f"there is no file {path}; check the name")
    try:
        with h5py.File(path, "r") as file:
            names = sorted(file, key=lambda name: int(name.removeprefix("traj_")))
            found = [_trajectory(name, file[name]) for name in names]
    except (OSError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise UsageError(f"{path} is not of LESS' layout: {' '.join(str(error).split())}") from None
    return [each for each in found if each is not None]


def _trajectory(name: str, group: Any) -> Trajectory | None:
    felt, time, robot_time, position = (
        np.asarray(group[key], float)
        for key in ("xela/data", "xela/timestamps", "robot/timestamps", "robot/ee_position")
    )
    if len(felt) < LEAST or len(position) < LEAST:
        return None
    if felt.ndim != 3 or felt.shape[2] != 3 or position.shape[1:] != (3,):
        raise UsageError(f"{name} has taxels of {felt.shape} and positions of {position.shape}")
    if len(time) != len(felt) or len(robot_time) != len(position):
        raise UsageError(f"{name} has not as many times as samples")
    at = np.column_stack([np.interp(time, robot_time, axis) for axis in position.T])
    return Trajectory(name, time, felt, at)
