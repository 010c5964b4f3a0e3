"""A probe streams for an hour of its own time, stroke after stroke, and its heap is as it was.

MicroPython itself, at whatever speed this computer has. The board does twenty strokes of it with the heap as
exactly as flat (tests/sim/probe/test_rp2040_strokes.py): in the emulation an hour would take a day.
"""

import numpy as np
import pytest

from palpate.link import emulator_model as emulator
from palpate.sim.probe import source
from palpate.sim.probe.over_lump import strokes_over
from tests.campaigns import counted
from tests.micropython import run_micropython
from tests.sim.probe.board_bench import kept_files

pytestmark = [pytest.mark.long, pytest.mark.timeout(0)]

FRAMES = 50 * 3600
STROKES = 5
WARM = 2  # turns until what is made once is there
SLACK = 512  # bytes: answers that the probe remembers are longer or shorter

SCRIPT = """
import gc
from firmware_py import estimator, flash, messages, probe, status, store, wire

RECORDS = memoryview(open("way", "rb").read())
WAY = len(RECORDS) // 632
PIECES = [RECORDS[632 * k + 8 : 632 * (k + 1)] for k in range(WAY)]

def number(at):
    value = int.from_bytes(RECORDS[at : at + 4], "little")
    return value - (1 << 32) if value >> 31 else value

PLACES = [(number(632 * k), number(632 * k + 4)) for k in range(WAY)]

class Board:
    serial = b"12345678"
    boots = 1
    now = 0
    at = 0
    said = bytearray()
    asked = b""
    settings_record = None
    def ticks_us(self):
        return self.now
    def read(self, buffer):
        n = min(len(buffer), len(self.asked))
        buffer[:n] = self.asked[:n]
        self.asked = self.asked[n:]
        return n
    def write(self, buffer, start, stop):
        return stop - start
    def begin(self):
        pass
    def end(self):
        pass
    def position_um(self):
        return PLACES[self.at][0]
    def displacement_um(self):
        return PLACES[self.at][1]
    def start_scan(self):
        pass
    def scanned(self):
        return True
    def scan(self, counts):
        counts[:] = PIECES[self.at]
        self.at = (self.at + 1) % WAY

board = Board()
files = store.FileStore()
p = probe.Probe(board, estimator.Estimator(files, flash.Flash(files, files.read("key.pub", 0, 64))))
assert p.estimator.model_status == status.OK, p.estimator.model_status
body = bytearray(400)
packet = bytearray(500)
id = 0

def ask(name, values):
    global id
    id = id % 60000 + 1
    n = messages.pack(body, messages.TYPE[name], id, 0, values, b"")
    board.asked += bytes(packet[: wire.seal(body, n, packet, 1)])
    p.step()

def count(name):
    return p.counts[messages.COUNTERS.index(name)]

NAMES = (
    "frames_acquired", "frames_sent", "frames_dropped", "frames_overrun",
    "strokes", "estimates", "estimates_acknowledged",
)
ask("stream_start", (messages.CONTENT_FRAMES | messages.CONTENT_STROKES, 1, 0, 10000))
done = 0

def turn():
    # all the strokes once; the heap before them, which has just been cleared, and what was counted
    global done
    used = gc.mem_alloc()
    for _ in range(WAY):
        board.now = (board.now + 20000) & ((1 << 30) - 1)
        p.step()
        if count("strokes") > done:  # a host takes its results, and says now and then that it is there
            done = count("strokes")
            ask("stroke_ack", (p.stream.number, done, messages.HAVE_ALL))
            ask("stream_renew", (p.stream.number,))
    print(used, *[count(name) for name in NAMES])
"""


def test_an_hour_of_frames_and_strokes_leaves_the_heap_as_it_was(tmp_path):
    made, calibration = strokes_over("d12h07e20f09", "typical", 1, 40, STROKES, press=False)
    way = source.write_source(tmp_path / "way", made, source.LIFTED_AS_BY_HAND).read_bytes()
    (tmp_path / "store").mkdir()
    files = kept_files(tmp_path / "store", emulator.image(), calibration)
    files |= {"key.pub": emulator.public_key(), "way": way}
    frames_a_turn = len(way) // source.RECORD_BYTES
    turns = -(-FRAMES // frames_a_turn)
    said = run_micropython(SCRIPT, files, timeout_s=7200, turns=turns)
    used, acquired, sent, dropped, late, strokes, estimates, taken = np.loadtxt(
        said.splitlines(), dtype=int
    ).T
    used = used[WARM:]
    told = f"{acquired[-1]:,} frames, {strokes[-1]:,} strokes"
    counted(f"{told}; {used.min():,} to {used.max():,} bytes in use after each {frames_a_turn} frames")
    assert acquired[-1] == sent[-1] >= FRAMES
    assert dropped[-1] == late[-1] == 0
    assert strokes[-1] == estimates[-1] == taken[-1] >= STROKES * turns
    assert used.max() - used.min() < SLACK
