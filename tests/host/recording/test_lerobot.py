"""A recording as a LeRobot dataset, by the layout that LeRobot documents, and a sensor of its shape."""

import json

import numpy as np
import pandas as pd
import pytest

from palpate.cli import main
from palpate.errors import LinkError, UsageError
from palpate.recording.convert import convert
from palpate.sources.lerobot import TactileSensor
from palpate.wire.cells import PITCH_MM, SHAPE
from palpate.wire.events import Frame
from tests.host.link import wires
from tests.host.recording.recorded import record
from tests.host.sources.arrays import AIR, flexitac, port_of, uniform

DEFAULT = {"timestamp", "frame_index", "episode_index", "index", "task_index"}
"""What every LeRobot dataset has."""


@pytest.fixture
def dataset(tmp_path, capsys):
    """A dataset of 60 frames, of which two were lost, and the frames."""
    rng = np.random.default_rng(3)
    data = wires.identified() + b"".join(wires.frame(k, rng=rng) for k in range(60) if k not in (7, 20))
    events = record(tmp_path / "visit.mcap", data)
    assert main(["convert", str(tmp_path / "visit.mcap"), str(tmp_path / "set"), "--to", "lerobot"]) == 0
    capsys.readouterr()
    return tmp_path / "set", [event for event in events if isinstance(event, Frame)]


def test_the_layout_is_the_documented_one(dataset):
    root, _ = dataset
    info = json.loads((root / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0" and info["splits"] == {"train": "0:1"}
    data = pd.read_parquet(root / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(data.columns) == set(info["features"]) >= DEFAULT
    assert len(data) == info["total_frames"] and info["total_episodes"] == info["total_tasks"] == 1
    tasks = pd.read_parquet(root / "meta/tasks.parquet")
    assert tasks.index.tolist() == ["palpate"] and tasks.task_index.tolist() == [0]
    [episode] = pd.read_parquet(root / "meta/episodes/chunk-000/file-000.parquet").to_dict("records")
    assert (episode["dataset_from_index"], episode["dataset_to_index"]) == (0, len(data))
    stats = json.loads((root / "meta/stats.json").read_text())
    for name, feature in info["features"].items():
        assert set(stats[name]) == {"min", "max", "mean", "std", "count"}
        assert np.shape(stats[name]["mean"]) == tuple(feature["shape"])
        assert f"stats/{name}/mean" in episode


def test_frames_stand_at_a_fixed_rate_and_lost_ones_are_the_one_before(dataset):
    root, frames = dataset
    info = json.loads((root / "meta/info.json").read_text())
    data = pd.read_parquet(root / "data/chunk-000/file-000.parquet")
    assert np.abs(data.timestamp - data.frame_index / info["fps"]).max() < 1e-4  # LeRobot's own tolerance
    kPa = np.array([[row.tolist() for row in image] for image in data["observation.tactile"]])
    assert kPa.shape == (60, *SHAPE)
    by_number = {frame.seq: frame for frame in frames}
    for k in range(60):
        frame = by_number[k if k in by_number else k - 1]
        assert np.array_equal(kPa[k].astype(np.float32), frame.pressure_kPa)
    state = np.stack(data["observation.state"])
    assert state[3, 2] == pytest.approx(frames[3].pressure_kPa.sum() * PITCH_MM**2 / 1000, rel=1e-5)


def test_a_directory_that_is_there_is_never_written_over(dataset, tmp_path, capsys):
    before = sorted(tmp_path.rglob("*"))
    words = ["convert", str(tmp_path / "visit.mcap"), str(tmp_path / "set"), "--to", "lerobot"]
    assert main([*words, "--overwrite"]) == 1
    assert "exists already" in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == before
    record(tmp_path / "short.mcap", wires.identified() + wires.frame(0))
    with pytest.raises(Exception, match="too few frames"):
        convert(tmp_path / "short.mcap", tmp_path / "other", to="lerobot")


def test_a_sensor_of_its_shape_reads_live():
    with flexitac([AIR] * 60 + [uniform(5.0)] * 1000) as speaker:
        sensor = TactileSensor(port_of(speaker))
        with pytest.raises(UsageError, match="not connected"):
            sensor.read()
        with sensor:
            assert sensor.is_connected and sensor.features["tactile"]["shape"] == SHAPE
            image = sensor.read()
            assert image.shape == SHAPE and image.dtype == np.float32
            while sensor.async_read(timeout_ms=60_000).mean() < 5:
                pass
            with pytest.raises(UsageError, match="connected already"):
                sensor.connect()
        assert not sensor.is_connected
    with pytest.raises(LinkError):
        sensor.connect()
