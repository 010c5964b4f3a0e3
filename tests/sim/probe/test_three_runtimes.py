"""Three runtimes, one answer: CPython and MicroPython/WASM give the same integers.

The third, MicroPython on a Cortex-M0+, is the emulated board's: test_rp2040.py and test_rp2040_strokes.py.
"""

import inspect
import json
import struct
from array import array

import pytest

from firmware_py import calib, evaluator, forcemap, pipeline, status
from palpate.model_export.integers import compiler
from tests.firmware_py.stages import any_force_map, strokes
from tests.micropython import run_micropython
from tests.model_export import synthetic

FRAMES = 40


@pytest.fixture(scope="module")
def tables():
    """A model of the thesis' size and one of the field's."""
    return {kind: compiler.compile_model(synthetic.model(kind)) for kind in ("thesis", "field")}


WHOLE = """
import struct
try:
    from micropython import heap_lock, heap_unlock
except ImportError:  # CPython
    heap_lock = heap_unlock = int
from array import array
from firmware_py import calib, evaluator, forcemap, pipeline
exec(open("tables").read())
models = [evaluator.Tables(*arguments) for arguments in TABLES]
force_map = forcemap.load(open("force_map", "rb").read())
calibration = calib.Calibration()
p = pipeline.Pipeline(calibration)
out = array("i", bytes(4 * evaluator.OUT_SIZE))
f = open("strokes", "rb")
n, frames = struct.unpack("<ii", f.read(8))
for k in range(n):
    assert calibration.load(f.read(calib.BLOB_BYTES)) == 0
    p.reset()
    for i in range(frames):
        position, displacement = struct.unpack("<ii", f.read(8))
        frame = f.read(624)
        heap_lock()
        p.add_frame(frame, position, displacement)
        heap_unlock()
    code = p.finish(force_map if k % 2 else None)
    answer = [code, p.place_um, p.n, p.stuck] + list(p.features) + list(p.map) + list(p.fit) + list(p.span)
    for model in models:
        answer.append(model.evaluate(p.features, out))
        answer += list(out)
    print(*answer)
"""


def table_text(tables):
    """The models' arrays as a line of Python."""
    names = inspect.signature(evaluator.Tables).parameters
    rows = ["(" + ", ".join(text_of(getattr(table, name)) for name in names) + ")" for table in tables]
    return f"TABLES = [{', '.join(rows)}]"


def text_of(value):
    if isinstance(value, array):
        return f"array({value.typecode!r}, {list(value)})"
    return repr(value)


def whole_strokes(tables, n):
    """What CPython says to n strokes, and the files with which `WHOLE` says it."""
    raw, mine = bytearray(struct.pack("<ii", n, FRAMES)), []
    calibration = calib.Calibration()
    p = pipeline.Pipeline(calibration)
    out = array("i", bytes(4 * evaluator.OUT_SIZE))
    force_map = any_force_map()
    loaded = forcemap.load(force_map)
    for k, (stream, of_probe) in enumerate(strokes(n, FRAMES)):
        raw += of_probe.to_bytes()
        calibration.load(of_probe.to_bytes())
        p.reset()
        for packed, position, displacement in zip(
            stream.packed, stream.positions_um, stream.displacements_um
        ):
            raw += struct.pack("<ii", int(position), int(displacement)) + packed
            p.add_frame(packed, int(position), int(displacement))
        answer = [p.finish(loaded if k % 2 else None), p.place_um, p.n, p.stuck]
        answer += [*p.features, *p.map, *p.fit, *p.span]
        for model in tables.values():
            answer.append(model.evaluate(p.features, out))
            answer += list(out)
        mine.append(answer)
    return mine, {
        "tables": table_text(tables.values()).encode(),
        "force_map": force_map,
        "strokes": bytes(raw),
    }


def whole_answers(tables, n):
    """What CPython and MicroPython/WASM say to the same n strokes."""
    mine, files = whole_strokes(tables, n)
    said = run_micropython(WHOLE, files, heap=4 << 20, timeout_s=1500)
    return mine, [[int(x) for x in line.split()] for line in said.splitlines()]


def test_whole_strokes_from_frames_to_estimates(tables):
    """And not one allocation while frames come in."""
    mine, theirs = whole_answers(tables, 24)
    assert theirs == mine
    assert sum(answer[0] == status.OK for answer in mine) > 12


@pytest.mark.long
def test_a_thousand_whole_strokes(tables):
    mine, theirs = whole_answers(tables, 1000)
    print(json.dumps({"strokes": len(mine), "numbers": sum(map(len, mine))}))
    assert theirs == mine
