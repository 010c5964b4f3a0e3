"""A recording as ROS 2 messages, read back by a library that is not the one that wrote them."""

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from palpate.cli import main
from palpate.errors import PalpateError, UnknownFormat
from palpate.recording.convert import convert
from palpate.wire.cells import COLUMN_MM, PITCH_MM, ROW_MM
from palpate.wire.events import Estimate, Frame
from tests.host.link import wires
from tests.host.recording.recorded import record

STORE = get_typestore(Stores.ROS2_HUMBLE)


def messages_of(path):
    """Every message by its topic: (time in ns, message)."""
    found = {}
    with Reader(path) as reader:
        for connection, time_ns, raw in reader.messages():
            message = STORE.deserialize_cdr(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((time_ns, message))
    return found


@pytest.fixture
def recorded(tmp_path):
    """A recording of five frames and an estimate, and its events."""
    rng = np.random.default_rng(4)
    data = wires.identified() + b"".join(wires.frame(k, rng=rng) for k in range(5)) + wires.estimate(1)
    return tmp_path / "visit.mcap", record(tmp_path / "visit.mcap", data)


def test_images_wrenches_and_estimates_are_those_of_the_recording(recorded, tmp_path, capsys):
    path, events = recorded
    out = tmp_path / "visit.ros2.mcap"
    assert main(["convert", str(path), str(out), "--to", "ros2"]) == 0
    capsys.readouterr()
    found = messages_of(out)
    frames = [event for event in events if isinstance(event, Frame)]
    assert len(found["/palpate/pressure"]) == len(frames) == 5
    for frame, (time_ns, image), (_, stamped) in zip(
        frames, found["/palpate/pressure"], found["/palpate/wrench"]
    ):
        kPa = image.data.view("<f4").reshape(image.height, image.width)
        assert image.encoding == "32FC1" and np.array_equal(kPa, frame.pressure_kPa)
        assert time_ns == frame.host_ns
        stamp = image.header.stamp
        assert stamp.sec * 1_000_000_000 + stamp.nanosec == frame.host_ns
        force, torque = stamped.wrench.force, stamped.wrench.torque
        total_N = kPa.sum(dtype=float) * PITCH_MM**2 / 1000
        assert force.z == pytest.approx(-total_N, rel=1e-6)
        centre_mm = 1000 * np.array([-torque.y, torque.x]) / force.z
        expected = [(kPa.sum(axis=1) * ROW_MM).sum(), (kPa.sum(axis=0) * COLUMN_MM).sum()] / kPa.sum()
        assert centre_mm == pytest.approx(expected, abs=1e-3)
    [estimate] = [event for event in events if isinstance(event, Estimate)]
    [(_, told)] = found["/diagnostics"]
    values = {each.key: each.value for each in told.status[0].values}
    assert float(values["d_mm_value"]) == estimate.as_dict()["d_mm"]["value"]
    assert told.status[0].name == "palpate: lump"


def test_a_wrong_name_and_the_recording_itself_are_refused(recorded, tmp_path):
    path, _ = recorded
    with pytest.raises(UnknownFormat, match=r"\.mcap"):
        convert(path, tmp_path / "visit.bag", to="ros2")
    before = path.read_bytes()
    with pytest.raises(PalpateError, match="is the recording itself"):
        convert(path, path, overwrite=True, to="ros2")
    assert path.read_bytes() == before
