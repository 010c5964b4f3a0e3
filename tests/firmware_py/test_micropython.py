"""The pipeline on real MicroPython: the same integers, and not one allocation while frames come in."""

import struct

import pytest

from firmware_py import calib, status
from palpate.firmware_twin.replay_core import Replay
from palpate.sim.probe.sensors import LEVELS, SensorModel
from tests.micropython import ScriptFailed, run_micropython

SCRIPT = """
import micropython, struct
from firmware_py import calib, forcemap, pipeline

force_map = forcemap.load(open("map", "rb").read())
data = open("strokes", "rb").read()
frames, at = [], 0
for k in range(len(data) // 632):
    position, displacement = struct.unpack("<ii", data[at + 624:at + 632])
    frames.append((data[at:at + 624], position, displacement))
    at += 632

def feed(p, frames):
    micropython.heap_lock()
    codes = 0
    for f in frames:
        codes |= p.add_frame(f[0], f[1], f[2])
    micropython.heap_unlock()
    return codes

calibration = calib.Calibration()
calibration.load(open("calibration", "rb").read())
p = pipeline.Pipeline(calibration)
for k in range(0, len(frames), 50):
    p.reset()
    assert feed(p, frames[k:k + 50]) == 0
    print(p.finish(force_map), *p.features, *p.map, *p.fit, *p.span)
"""


def numbers(pipeline, code):
    p = pipeline
    return [code, *p.features, *p.map, *p.fit, *p.span]


def test_the_same_integers_with_the_heap_locked(fields, map_blob):
    raw, expected = b"", []
    replay = Replay(map_blob)
    calibration = calib.Calibration()
    calibration.set_dead([3, 77, 78, 400])
    streams = [
        SensorModel(fields[k], LEVELS["typical"], k, across_mm=4.0 if k == 1 else None).stroke()
        for k in range(3)
    ]
    for stream in streams:
        expected.append(numbers(replay.pipeline, replay.stream(stream, calibration)))
    assert sum(e[0] == status.OK for e in expected) >= 2
    for s in streams:
        for k, packed in enumerate(s.packed):
            raw += packed + struct.pack("<ii", int(s.positions_um[k]), int(s.displacements_um[k]))
    files = {"strokes": raw, "map": map_blob, "calibration": calibration.to_bytes()}
    said = run_micropython(SCRIPT, files)
    assert [[int(v) for v in line.split()] for line in said.splitlines()] == expected


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
