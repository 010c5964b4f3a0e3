"""The firmware in this process, on a clock of its own: an hour of streaming takes seconds, and nothing races.

Units: us. The firmware is the same; only its board is made of Python lists.
"""

import struct
from collections.abc import Callable

from firmware_py import counters, messages, safe_record
from firmware_py.probe import Probe
from palpate.sim.probe import source
from palpate.sim.probe.flash_sim import FlashSim


class VirtualBoard:
    """A board (firmware_py/boards/__init__.py) whose clock stands still unless it is told to go on.

    Parameters
    frames: source records (source.RECORD_BYTES each) that the sensors read, over and over; default: in
        the air
    bytes_per_s: what the link to the host carries (0: everything at once)
    link_bytes: how much the link holds before it takes no more
    """

    serial = b"VIRTUAL0"
    boots = 1

    def __init__(
        self, frames: bytes = b"", bytes_per_s: int = 0, link_bytes: int = 4096, start_us: int = 0
    ) -> None:
        self.frames = frames or source.lifted_record()
        self.now_us = start_us  # does not wrap
        self.to_probe = bytearray()
        self.from_probe = bytearray()
        self.settings_record = safe_record.Record(FlashSim(), "set")
        self._bytes_per_s = bytes_per_s
        self._link_bytes = link_bytes
        self._in_flight = bytearray()
        self._credit = 0.0
        self._at = self._current = 0
        self.streaming = False

    def ticks_us(self) -> int:
        return self.now_us & counters.MASK

    def idle(self, us: int) -> None:
        """Let time pass; the link carries what it can."""
        self.now_us += us
        if self._bytes_per_s:
            self._credit = min(self._credit + us * self._bytes_per_s / 1e6, self._link_bytes)
            n = min(int(self._credit), len(self._in_flight))
            self._credit -= n
            self.from_probe += self._in_flight[:n]
            del self._in_flight[:n]

    def read(self, buffer: bytearray) -> int:
        n = min(len(buffer), len(self.to_probe))
        buffer[:n] = self.to_probe[:n]
        del self.to_probe[:n]
        return n

    def write(self, buffer: bytearray, start: int, stop: int) -> int:
        if not self._bytes_per_s:
            self.from_probe += buffer[start:stop]
            return stop - start
        n = min(stop - start, self._link_bytes - len(self._in_flight))
        self._in_flight += buffer[start : start + n]
        return n

    def begin(self) -> None:
        self._at = 0
        self.streaming = True

    def end(self) -> None:
        self.streaming = False

    def position_um(self) -> int:
        self._current = self._at
        return struct.unpack_from("<i", self.frames, self._current)[0]

    def displacement_um(self) -> int:
        return struct.unpack_from("<i", self.frames, self._current + 4)[0]

    def start_scan(self) -> None:
        """Nothing to do beforehand."""

    def scanned(self) -> bool:
        return True

    def scan(self, counts: memoryview) -> None:
        counts[:] = self.frames[self._current + 8 : self._current + source.RECORD_BYTES]
        self._at = (self._at + source.RECORD_BYTES) % len(self.frames)


class VirtualProbe:
    """A probe on a VirtualBoard. `run` lets time pass; bytes go in through `send` and come out of `take`."""

    def __init__(self, board: VirtualBoard | None = None, estimator: object = None) -> None:
        self.board = board or VirtualBoard()
        self.firmware = Probe(self.board, estimator)

    def send(self, data: bytes) -> None:
        """The host writes."""
        self.board.to_probe += data

    def take(self) -> bytes:
        """What has arrived at the host."""
        data = bytes(self.board.from_probe)
        self.board.from_probe.clear()
        return data

    def run(self, us: int, each_step: Callable[[], None] | None = None) -> None:
        """Let so much time pass."""
        end = self.board.now_us + us
        while self.board.now_us < end:
            wait = self.firmware.step()
            self.board.idle(min(max(wait, 20), end - self.board.now_us))
            if each_step:
                each_step()

    def counter(self, name: str) -> int:
        """One of the probe's own counters, by its name in messages.COUNTERS."""
        return self.firmware.counts[messages.COUNTERS.index(name)]
