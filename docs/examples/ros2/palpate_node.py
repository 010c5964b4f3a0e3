"""A ROS 2 node that publishes a probe, or somebody's array, live: python palpate_node.py --port auto

Topics and frame as in recordings that `palpate convert --to ros2` writes (palpate.recording.ros2).
"""

from __future__ import annotations

import argparse
import threading
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rosidl_runtime_py.set_message import set_message_fields
from sensor_msgs.msg import Image

from palpate import Probe
from palpate.recording import ros2
from palpate.wire.events import Estimate, Frame


class PalpateNode(Node):
    """Publishes every frame's image and wrench, and every estimate."""

    def __init__(self, port: str) -> None:
        super().__init__("palpate")
        self._image = self.create_publisher(Image, ros2.PRESSURE, 10)
        self._wrench = self.create_publisher(WrenchStamped, ros2.WRENCH, 10)
        self._diagnostics = self.create_publisher(DiagnosticArray, ros2.DIAGNOSTICS, 10)
        self._thread = threading.Thread(target=self._follow, args=(port,), daemon=True)
        self._thread.start()

    def _follow(self, port: str) -> None:
        with Probe.open(port) as probe:
            for event in probe.stream():
                if isinstance(event, Frame):
                    self._image.publish(_filled(Image(), ros2.image(event)))
                    self._wrench.publish(_filled(WrenchStamped(), ros2.wrench(event)))
                elif isinstance(event, Estimate):
                    told = ros2.diagnostics(event, probe.identity.serial)
                    for status in told["status"]:
                        status["level"] = bytes([status["level"]])  # rclpy's `byte`
                    self._diagnostics.publish(_filled(DiagnosticArray(), told))


def _filled(message: Any, words: dict[str, Any]) -> Any:
    set_message_fields(message, words)
    return message


def main() -> None:
    """Run until Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", default="auto", help="As `palpate stream --port` takes it.")
    arguments = parser.parse_args()
    rclpy.init()
    try:
        rclpy.spin(PalpateNode(arguments.port))
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
