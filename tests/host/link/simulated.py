"""The real firmware on a virtual clock, streaming through a line that loses bytes into the live parser."""

from __future__ import annotations

import tracemalloc
from dataclasses import dataclass

from firmware_py import messages
from palpate.link.commands import pack_command
from palpate.sim.probe.faults import Faults, FaultyLine
from palpate.sim.probe.virtual import VirtualBoard, VirtualProbe
from palpate.wire.events import Frame
from palpate.wire.parser import LiveParser

BYTES_PER_S = 92_160
STEP_US = 100_000


@dataclass(frozen=True)
class Told:
    """What came of it: the probe's count of frames, the host's, and what is really missing."""

    acquired: int
    received: int
    lost: int
    missing: int
    packets_damaged: int
    grown_bytes: int


def stream_over_a_bad_line(minutes: float, seed: int, lose: float = 0.001) -> Told:
    """Stream for so many simulated minutes at 50 frames/s over 921,600 baud; count at both ends."""
    probe = VirtualProbe(VirtualBoard(bytes_per_s=BYTES_PER_S))
    line = FaultyLine(Faults(lose=lose), seed)
    parser = LiveParser()
    seen = bytearray()  # one bit for each number that came: grows by 6 bytes a second

    def hear(data: bytes) -> None:
        for event in parser.feed(data, 1000 * probe.board.now_us):
            if isinstance(event, Frame):
                if event.seq // 8 >= len(seen):
                    seen.extend(bytes(event.seq // 8 + 1 - len(seen)))
                seen[event.seq // 8] |= 1 << event.seq % 8

    probe.send(pack_command("stream_start", 1, (messages.CONTENT_FRAMES, 1, 0, messages.LEASE_MOST_MS)))
    probe.run(20_000)
    hear(probe.take())  # the beginning comes through: from here on every frame is promised
    tracemalloc.start()
    steps = int(minutes * 60e6 / STEP_US)
    settled = 0
    for step in range(steps):
        probe.run(STEP_US)
        probe.firmware.stream.heard(probe.board.ticks_us())  # as by a word of the host's
        hear(line.pass_through(probe.take()))
        if step == steps // 10:
            settled = tracemalloc.get_traced_memory()[0]
    grown = tracemalloc.get_traced_memory()[0] - settled - len(seen)
    tracemalloc.stop()
    probe.send(pack_command("stream_stop", 2))
    probe.run(1_000_000)
    hear(b"\0" + probe.take())
    parser.settle()
    acquired = probe.counter("frames_acquired")
    came = sum(byte.bit_count() for byte in seen)
    counts, damage = parser.frames.counts, parser.counts
    return Told(
        acquired, counts.received, counts.lost, acquired - came, damage.bad_crc + damage.bad_frame, grown
    )
