"""On real MicroPython the frame path allocates nothing: it runs with the heap locked.

tests/sim/probe/test_three_runtimes.py holds its integers.
"""

import struct

import numpy as np
import pytest

from firmware_py import geometry
from tests.micropython import ScriptFailed, run_micropython

SCRIPT = """
import gc
import micropython
from firmware_py import estimator, messages, probe, store

FRAMES = open("frames", "rb").read()
RECORD = 632

class Board:
    serial = b"12345678"
    boots = 1
    now = 1 << 29
    at = 0
    taken = 0
    def ticks_us(self):
        return self.now
    def read(self, buffer):
        return 0
    def write(self, buffer, start, stop):
        self.taken += stop - start
        return stop - start
    def begin(self):
        pass
    def end(self):
        pass
    def _int(self, at):
        v = FRAMES[at] | FRAMES[at + 1] << 8 | FRAMES[at + 2] << 16
        return v - 0x1000000 if v & 0x800000 else v
    def position_um(self):
        return self._int(self.at)
    def displacement_um(self):
        return self._int(self.at + 4)
    def start_scan(self):
        pass
    def scanned(self):
        return True
    def scan(self, counts):
        for i in range(624):
            counts[i] = FRAMES[self.at + 8 + i]
        self.at = (self.at + RECORD) % len(FRAMES)
    settings_record = None

board = Board()
p = probe.Probe(board, estimator.Estimator(store.FileStore()))
p.start_stream(messages.CONTENT_FRAMES | messages.CONTENT_STROKES, 1, 0)

def run(n):
    for i in range(n):
        board.now = (board.now + 20000) & ((1 << 30) - 1)
        p.step()

run(6)  # contact and start are told, which allocates
assert p.strokes.state == 2, p.strokes.state
gc.collect()
before = p.counts[1]
sent = p.counts[2]
micropython.heap_lock()
try:
    run(36)
finally:
    micropython.heap_unlock()
print(p.counts[1] - before, p.counts[2] - sent, p.estimator.pipeline.bins.count[0] >= 0)
"""


def test_forty_frames_of_a_stroke_with_the_heap_locked():
    """Acquired, watched, fed to the pipeline, checksummed, stuffed and sent: not one byte is allocated."""
    random = np.random.default_rng(2)
    records = bytearray()
    for k in range(60):
        counts = np.clip(800 + random.normal(0, 10, geometry.CELLS), 0, 4095).astype(np.uint32)
        pairs = counts[0::2] | counts[1::2] << 12
        records += struct.pack("<ii", -30000 + 1000 * k, 2500)
        records += b"".join(int(pair).to_bytes(3, "little") for pair in pairs)
    said = run_micropython(SCRIPT, {"frames": bytes(records)})
    assert said.split() == ["36", "36", "True"]


def test_the_lock_would_catch_an_allocation():
    """So the silence above means something."""
    script = """
import micropython
def grow():
    micropython.heap_lock()
    try:
        return bytearray(100)
    except MemoryError:
        print("caught")
    finally:
        micropython.heap_unlock()
grow()
"""
    assert run_micropython(script).strip() == "caught"


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("bytearray(100)", "memory was asked for while the heap was locked"),
        ("raise READY", "ValueError: made before"),
    ],
)
def test_a_script_that_fails_with_the_heap_locked_ends_and_says_so(line, says):
    """The interpreter hung, and a test that found an allocation said nothing for fifteen minutes."""
    script = "import micropython\nREADY = ValueError('made before')\nmicropython.heap_lock()\n"
    with pytest.raises(ScriptFailed, match=says):
        run_micropython(script + line, timeout_s=60)
