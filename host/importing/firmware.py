"""The firmware in this process, fed with any frames at their own times: how imports become recordings.

What it says goes into the recording as if it had come over a wire, so everything that reads recordings reads
imports as well. Units: um, us, counts of 12 bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from firmware_py import calib, geometry, messages, status
from firmware_py.estimator import Estimator
from firmware_py.probe import Probe
from palpate.firmware_twin.replay_core import compiled
from palpate.link.commands import pack_command
from palpate.model_export.image_builder import Info
from palpate.recording.writer import RecordingWriter
from palpate.sim.probe.flash_sim import FlashSim
from palpate.sim.probe.virtual import VirtualBoard
from palpate.wire.delivery import HAVE
from palpate.wire.events import Answer, Estimate, Event, Features, TactileMap
from palpate.wire.packing import pack
from palpate.wire.parser import LiveParser

LIFTED = 3
"""Frames in the air before and after each stroke."""
AIR = pack(np.full(geometry.CELLS, geometry.PEDESTAL_COUNTS, np.uint16))
RENEW_US = messages.LEASE_MOST_MS * 500


class _Board(VirtualBoard):
    """It reads what it is given; its clock stands until it is told."""

    serial = b"IMPORTED"

    def __init__(self) -> None:
        super().__init__()
        self.packed, self.position, self.depth = AIR, 0, 0
        self.ready = False  # a frame is there to be read; a stream that begins would have one at once

    def scanned(self) -> bool:
        return self.ready

    def scan(self, counts: memoryview) -> None:
        counts[:] = self.packed
        self.ready = False

    def position_um(self) -> int:
        return self.position

    def displacement_um(self) -> int:
        return self.depth


class ImportedSession:
    """One recording in the making.

    Parameters
    ----------
    writer : RecordingWriter
    model : Info, optional
        Of the image that makes the estimates.
    began_ns : int
        Host time of the first frame.
    """

    def __init__(self, writer: RecordingWriter, model: Info | None, began_ns: int) -> None:
        self._writer, self._began_ns = writer, began_ns
        self._board: Any = _Board()
        estimator: Any = Estimator(FlashSim())
        estimator.pipeline = compiled().pipeline.Pipeline(calib.Calibration())
        if model is not None:
            estimator.model, estimator.model_status = model.model, status.OK
            estimator._force_map = model.model.force_map
        self._probe = Probe(self._board, estimator)
        self._parser = LiveParser(own_only=True)
        self._number = 0
        self._renewed_us = 0
        self._stream = 0
        self._command("identify", (1,))
        content = messages.CONTENT_FRAMES | messages.CONTENT_STROKES
        self._command("stream_start", (content, 1, 0, messages.LEASE_MOST_MS))

    def lifted(self, time_us: int, position_um: int) -> list[Event]:
        """Frames in the air, 1 ms apart from `time_us` on."""
        return [event for k in range(LIFTED) for event in self.frame(AIR, position_um, 0, time_us + 1000 * k)]

    def frame(self, packed: bytes, position_um: int, displacement_um: int, time_us: int) -> list[Event]:
        """One frame; what the probe says to it."""
        board = self._board
        board.packed, board.position, board.depth = packed, position_um, displacement_um
        board.now_us = time_us
        if time_us - self._renewed_us > RENEW_US and self._stream:
            self._renewed_us = time_us
            self._command("stream_renew", (self._stream,))
        board.ready = True
        self._probe.acquire.start(board.ticks_us())
        said = list(self._run())
        while self._probe.results.waiting() and any(isinstance(e, Estimate) for e in said):
            more = list(self._run())
            said += more
            if not more:
                break
        return said

    def end(self) -> None:
        """The stream stops."""
        self._command("stream_stop", ())
        self._parser.settle()

    def _command(self, name: str, values: tuple[int, ...]) -> None:
        self._number += 1
        raw = pack_command(name, self._number & 0xFFFF, values)
        self._parser.commanded(raw)
        self._writer.sent(raw, self._host_ns())
        self._board.to_probe += raw
        for event in self._run():
            if isinstance(event, Answer) and event.kind == messages.TYPE["stream_start"] | messages.ANSWER:
                self._stream = event.values[0]

    def _run(self) -> Iterator[Event]:
        """Let the firmware do what is due, and take down what it says; results are acknowledged."""
        self._probe.step()
        self._probe.step()
        data = bytes(self._board.from_probe)
        self._board.from_probe.clear()
        for event in self._parser.feed(data, self._host_ns()):
            self._writer.received(self._parser.raw, event, self._host_ns())
            if isinstance(event, Estimate | Features | TactileMap):
                self._number += 1
                values = (event.stream, event.stroke, HAVE[type(event)])
                raw = pack_command("stroke_ack", self._number & 0xFFFF, values)
                self._writer.sent(raw, self._host_ns())
                self._board.to_probe += raw
            yield event

    def _host_ns(self) -> int:
        return self._began_ns + 1000 * int(self._board.now_us)
