"""Three runtimes, one answer.

CPython, MicroPython/WASM and the micro:bit's MicroPython give the same integers.
"""

import json
import struct
from array import array

import numpy as np
import pytest

from firmware_py import calib, evaluator, features, forcemap, pipeline, rowpipeline, status
from model_export import compiler
from sim.probe.flat import Flattener
from sim.probe.microbit import MicroBit
from sim.probe.scripts import run_micropython
from sim.probe.sensors import StrokeField, stroke_frames
from sim.tissue import Case, Settings, simulate_forces
from tests.image import synthetic
from tests.probe.stages import digest, is_buffer, recorded

CODES = ("d12h08e10f10", "d08h05e50f06", "d20h10e03f08")


@pytest.fixture(scope="module")
def fields():
    """Three lumps, each stroked at two forces."""
    out = []
    for code in CODES:
        case = Case.from_code(code)
        pair = simulate_forces(case, [case.F_rel, 1.4 * case.F_rel], Settings(far_start_mm=-44.0))
        out.append(StrokeField(*pair))
    return out


def strokes(fields, n, frames=40):
    """n strokes over these lumps, through sensors from good to poor."""
    for seed in range(n):
        level = ("good", "typical", "poor")[seed // 3 % 3]
        yield stroke_frames(fields[seed % 3], level, seed, frames, travel_mm=76.0)


@pytest.fixture(scope="module")
def tables():
    """A model of the thesis' size and one of the field's."""
    return {kind: compiler.compile_model(synthetic.model(kind)) for kind in ("thesis", "field")}


@pytest.fixture(scope="module")
def force_map():
    """Any map will do: coefficients as large as a fitted one's."""
    random = np.random.default_rng(5)
    blob = bytearray(forcemap.BLOB_BYTES)
    blob[0], blob[1], blob[2] = 0x46, forcemap.VERSION, 12
    struct.pack_into("<ii", blob, 4, 78_000_000, 19_000_000)
    struct.pack_into(f"<{forcemap.COEFS}h", blob, 12, *random.integers(-300, 300, forcemap.COEFS).tolist())
    return bytes(blob)


WHOLE = """
import struct
from array import array
from firmware_py import calib, evaluator, forcemap, pipeline
exec(open("tables").read())
models = [evaluator.Tables(*arguments) for arguments in TABLES]
force_map = forcemap.load(open("force_map", "rb").read())
p = pipeline.Pipeline(calib.Calibration())
out = array("i", bytes(4 * evaluator.OUT_SIZE))
f = open("strokes", "rb")
n, frames = struct.unpack("<ii", f.read(8))
for k in range(n):
    p.reset()
    for i in range(frames):
        position, displacement = struct.unpack("<ii", f.read(8))
        p.add_frame(f.read(624), position, displacement)
    code = p.finish(force_map if k % 2 else None)
    answer = [code, p.place_um] + list(p.features) + list(p.map) + list(p.fit)
    for model in models:
        answer.append(model.evaluate(p.features, out))
        answer += list(out)
    print(*answer)
"""


def table_text(tables):
    """The models' arrays as a line of Python."""
    names = ("ids", "feats", "steps", "c", "d", "rows", "outs", "limits", "head")
    rows = ["(" + ", ".join(text_of(getattr(table, name)) for name in names) + ")" for table in tables]
    return f"TABLES = [{', '.join(rows)}]"


def text_of(value):
    if isinstance(value, array):
        return f"array({value.typecode!r}, {list(value)})"
    return repr(value)


def whole_answers(fields, tables, force_map, n):
    """What CPython and MicroPython/WASM say to the same n strokes."""
    raw, mine = bytearray(struct.pack("<ii", n, 40)), []
    p = pipeline.Pipeline(calib.Calibration())
    out = array("i", bytes(4 * evaluator.OUT_SIZE))
    loaded = forcemap.load(force_map)
    for k, stream in enumerate(strokes(fields, n)):
        p.reset()
        for packed, position, displacement in zip(
            stream.packed, stream.positions_um, stream.displacements_um
        ):
            raw += struct.pack("<ii", int(position), int(displacement)) + packed
            p.add_frame(packed, int(position), int(displacement))
        answer = [p.finish(loaded if k % 2 else None), p.place_um, *p.features, *p.map, *p.fit]
        for model in tables.values():
            answer.append(model.evaluate(p.features, out))
            answer += list(out)
        mine.append(answer)
    files = {"tables": table_text(tables.values()).encode(), "force_map": force_map, "strokes": bytes(raw)}
    said = run_micropython(WHOLE, files, heap=4 << 20, timeout_s=1500)
    return mine, [[int(x) for x in line.split()] for line in said.splitlines()]


def test_whole_strokes_from_frames_to_estimates(fields, tables, force_map):
    mine, theirs = whole_answers(fields, tables, force_map, 60)
    assert theirs == mine
    assert sum(answer[0] == status.OK for answer in mine) > 40


@pytest.mark.long
def test_a_thousand_whole_strokes(fields, tables, force_map):
    mine, theirs = whole_answers(fields, tables, force_map, 1000)
    print(json.dumps({"strokes": len(mine), "numbers": sum(map(len, mine))}))
    assert theirs == mine


def feature_vectors(n):
    """Feature vectors in and about the models' domains."""
    random = np.random.default_rng(8)
    span = np.array([random.normal(0, 1.5, features.COUNT) * (1 << 24) for _ in range(n)])
    middle = np.array(
        [4.0, 2.0, 1.5, 1.0, 1.0, 0.8, 4.5, 3.0, 1.0, 0.1, 0.1, -3.0] + [0.2] * (features.COUNT - 12)
    )
    return np.clip(span * 0.3 + middle * (1 << 24), -(2**29) + 1, 2**29 - 1).astype(int).tolist()


def test_a_thousand_estimates(tables):
    vectors = feature_vectors(1000)
    raw = b"".join(struct.pack(f"<{features.COUNT}i", *v) for v in vectors)
    script = f"""
import struct
from array import array
from firmware_py import evaluator
exec(open("tables").read())
models = [evaluator.Tables(*arguments) for arguments in TABLES]
out = array("i", bytes(4 * evaluator.OUT_SIZE))
f = open("vectors", "rb")
for k in range(1000):
    x = array("i", struct.unpack("<{features.COUNT}i", f.read(4 * {features.COUNT})))
    print(*([m.evaluate(x, out) for m in models[:1]] + list(out) + [m.evaluate(x, out) for m in
    models[1:]] + list(out)))
"""
    files = {"tables": table_text(tables.values()).encode(), "vectors": raw}
    said = run_micropython(script, files)
    out = array("i", bytes(4 * evaluator.OUT_SIZE))
    expected = []
    for v in vectors:
        line = []
        for model in tables.values():
            line += [model.evaluate(array("i", v), out), *out]
        expected.append(line)
    assert [[int(x) for x in line.split()] for line in said.splitlines()] == expected


# ---- the micro:bit: stage by stage, each with what the stage before it gave in real strokes

STAGES = {
    "traces.map_rows": 8,
    "search.bump_table": 6,
    "search.search": 30,
    "gaussfit._prepare": 40,
    "gaussfit._evaluate": 90,
    "gaussfit._solve": 90,
    "gaussfit.relative": 90,
    "gaussfit.start": 90,
    "features.from_fit": 90,
    "features.from_profile": 40,
    "features.finish": 90,
}


def typecode_of(buffer):
    return buffer.typecode if isinstance(buffer, array) else "B"


def replay(name, calls):
    """Call a function on the micro:bit with recorded arguments: the first outcome that differs, or None."""
    flat = Flattener()
    flat.add(name)
    buffers = {f"a{i}": a for i, a in enumerate(calls[0].before) if is_buffer(a)}
    arrays = {n: (typecode_of(a), len(a)) for n, a in buffers.items()}
    kept: dict[str, tuple] = {}
    with MicroBit() as bit:
        bit.load(flat, arrays)
        print(json.dumps({"function": name, "vectors": len(calls), "free bytes": bit.free_bytes()}))
        for index, call in enumerate(calls):
            words = [f"a{i}" if is_buffer(a) else str(int(a)) for i, a in enumerate(call.before)]
            for word, argument in zip(words, call.before, strict=True):
                if is_buffer(argument) and kept.get(word) != tuple(argument):
                    bit.put(word, list(argument))
            said = bit.run(f"print(g.{flat.names[name]}({','.join(words)}))").strip()
            if said != str(call.returned):
                return index, said, call.returned
            for word, argument in zip(words, call.after, strict=True):
                if is_buffer(argument):
                    kept[word] = tuple(argument)
                    if bit.check_sum(word) != digest(argument):
                        return index, word
    return None


@pytest.fixture(scope="module")
def calls(fields, force_map):
    loaded = forcemap.load(force_map)
    with recorded(*STAGES, most=400) as calls:
        small = rowpipeline.RowPipeline(calib.Calibration(), 6, 20, n_bins=32, width_um=3000)
        for stream in strokes(fields, 102):
            small.reset()
            for packed, x, d in zip(stream.packed, stream.positions_um, stream.displacements_um):
                small.add_frame(packed, int(x), int(d))
            small.finish(loaded)
    return calls


@pytest.mark.parametrize("name", STAGES)
def test_the_micro_bit_computes_each_stage_of_the_pipeline(name, calls):
    sizes = [len(a) for a in calls[name][0].before if is_buffer(a)]
    alike = [c for c in calls[name] if [len(a) for a in c.before if is_buffer(a)] == sizes]
    vectors = alike[: STAGES[name]]
    assert len(vectors) == STAGES[name]
    assert replay(name, vectors) is None


EVALUATOR = ("mul28", "scaled", "dot", "width", "value", "verdict")


@pytest.mark.parametrize("name", [f"evaluator.{name}" for name in EVALUATOR])
def test_the_micro_bit_computes_the_evaluators_steps(name, tables):
    """`compute` itself and a model together are more than its heap; these are all that it calls."""
    out = array("i", bytes(4 * evaluator.OUT_SIZE))
    with recorded(name) as calls:
        for vector in feature_vectors(100):
            tables["thesis"].evaluate(array("i", vector), out)
    sizes = [len(a) for a in calls[name][0].before if is_buffer(a)]
    vectors = [c for c in calls[name] if [len(a) for a in c.before if is_buffer(a)] == sizes]
    assert len(vectors) == 100
    assert replay(name, vectors) is None
