"""A recording as ROS 2 messages in an MCAP file, without ROS: `ros2 bag`, PlotJuggler and Foxglove open it.

Topics: /palpate/pressure (sensor_msgs/Image, 32FC1, kPa; one row of the image a row of cells),
/palpate/wrench (geometry_msgs/WrenchStamped: force and torque on the face) and /diagnostics
(diagnostic_msgs/DiagnosticArray: the estimates). Frame palpate_face: its middle, x along the stroke, y
across, z into the tissue. The tissue pushes back, so force.z is negative; the centre of pressure is
x = -torque.y / force.z, y = torque.x / force.z.

Source of the definitions: sensor_msgs, geometry_msgs, diagnostic_msgs, std_msgs of ROS 2 (Humble).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import MissingExtra
from palpate.files import whole_file
from palpate.recording.playback import open_recording
from palpate.wire.cells import COLUMN_MM, PITCH_MM, ROW_MM
from palpate.wire.events import Estimate, Frame

FACE = "palpate_face"
PRESSURE, WRENCH, DIAGNOSTICS = "/palpate/pressure", "/palpate/wrench", "/diagnostics"
_RULE = "=" * 80
_HEADER = f"""{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
SCHEMAS = {
    PRESSURE: (
        "sensor_msgs/msg/Image",
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\n"
        f"uint32 step\nuint8[] data\n{_HEADER}",
    ),
    WRENCH: (
        "geometry_msgs/msg/WrenchStamped",
        f"std_msgs/Header header\ngeometry_msgs/Wrench wrench\n{_HEADER}{_RULE}\nMSG: geometry_msgs/Wrench\n"
        f"geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n{_RULE}\nMSG: geometry_msgs/Vector3\n"
        "float64 x\nfloat64 y\nfloat64 z\n",
    ),
    DIAGNOSTICS: (
        "diagnostic_msgs/msg/DiagnosticArray",
        f"std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n{_HEADER}{_RULE}\n"
        "MSG: diagnostic_msgs/DiagnosticStatus\nbyte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\n"
        "byte level\nstring name\nstring message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values\n"
        f"{_RULE}\nMSG: diagnostic_msgs/KeyValue\nstring key\nstring value\n",
    ),
}
"""Topic -> type of its messages and its definition."""
_CELL_M2 = (PITCH_MM / 1000) ** 2


def to_ros2(recording: Path, out: Path) -> tuple[int, int, int, bool]:
    """Write a recording's frames and estimates as ROS 2 messages.

    Parameters
    ----------
    recording, out : Path
        Both .mcap.

    Returns
    -------
    Numbers of frames, estimates and lost frames; whether the pressures are calibrated.

    Raises
    ------
    MissingExtra
        mcap-ros2-support is not installed.
    NoSuchFile, NotARecording, DiskFull, PalpateError
        It cannot be read, or not be written; nothing is left of it then.
    """
    try:
        from mcap_ros2.writer import Writer
    except ImportError:
        raise MissingExtra("mcap-ros2-support", "ros2", "writing ROS 2 messages") from None
    frames = estimates = 0
    with open_recording(recording) as session, whole_file(out) as path, path.open("wb") as stream:
        writer = Writer(stream)
        schemas = {topic: writer.register_msgdef(*told) for topic, told in SCHEMAS.items()}
        for event in session.events():
            if isinstance(event, Frame):
                messages = {PRESSURE: image(event), WRENCH: wrench(event)}
                frames += 1
            elif isinstance(event, Estimate):
                messages = {DIAGNOSTICS: diagnostics(event, session.identity.serial)}
                estimates += 1
            else:
                continue
            for topic, message in messages.items():
                writer.write_message(topic, schemas[topic], message, event.host_ns, event.host_ns, frames)
        writer.finish()
        return frames, estimates, session.frame_counts.lost, session.scale.calibrated


def image(frame: Frame) -> dict[str, Any]:
    """A frame as sensor_msgs/Image, 32FC1 in kPa."""
    kPa = np.ascontiguousarray(frame.pressure_kPa, "<f4")
    height, width = kPa.shape
    return {
        "header": _header(frame.host_ns),
        "height": height,
        "width": width,
        "encoding": "32FC1",
        "is_bigendian": 0,
        "step": 4 * width,
        "data": kPa.tobytes(),
    }


def wrench(frame: Frame) -> dict[str, Any]:
    """A frame as geometry_msgs/WrenchStamped: N and N m about the face's middle."""
    force_N = -1000 * _CELL_M2 * frame.pressure_kPa.astype(np.float64)
    torque = {
        "x": float((force_N * COLUMN_MM).sum()) / 1000,
        "y": -float((force_N * ROW_MM[:, None]).sum()) / 1000,
        "z": 0.0,
    }
    force = {"x": 0.0, "y": 0.0, "z": float(force_N.sum())}
    return {"header": _header(frame.host_ns), "wrench": {"force": force, "torque": torque}}


def diagnostics(estimate: Estimate, serial: str) -> dict[str, Any]:
    """An estimate as diagnostic_msgs/DiagnosticArray; a warning where it is not to be relied on."""
    told = estimate.as_dict()
    values: list[dict[str, str]] = []
    for name, value in told.items():
        if isinstance(value, dict):
            values += [{"key": f"{name}_{part}", "value": f"{each}"} for part, each in value.items()]
        else:
            values.append({"key": name, "value": f"{value}"})
    sure = estimate.valid and estimate.in_domain
    message = told["hardness"] if estimate.lump and sure else told["reason"] or "outside the model"
    status = {
        "level": 0 if sure else 1,
        "name": "palpate: lump",
        "message": str(message),
        "hardware_id": serial,
        "values": values,
    }
    return {"header": {**_header(estimate.host_ns), "frame_id": ""}, "status": [status]}


def _header(host_ns: int) -> dict[str, Any]:
    seconds, nanoseconds = divmod(host_ns, 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": FACE}
