"""Three runtimes, one answer.

CPython, MicroPython/WASM and the micro:bit's MicroPython give the same integers.
"""

import copy
import importlib
import json
import struct
from array import array

import numpy as np
import pytest

from firmware_py import calib, evaluator, features, forcemap, pipeline, rowpipeline, status
from model_export import compiler
from sim.probe.flat import Flattener
from sim.probe.microbit import WAYS, MicroBit
from sim.probe.scripts import ScriptFailed, run_micropython
from sim.probe.sensors import StrokeField, stroke_frames
from sim.tissue import Case, Settings, simulate_forces
from tests.image import synthetic
from tests.probe.stages import Call, digest, is_buffer, recorded

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

STAGES = (
    "rowpipeline.add_rows",
    "rowpipeline.mean_rows",
    "forcemap.slopes",
    "forcemap.move",
    "chain.widest_gap",
    "traces.map_rows",
    "search.bump_table",
    "search.search",
    "gaussfit.start",
    "gaussfit._prepare",
    "gaussfit._evaluate",
    "gaussfit._solve",
    "gaussfit.relative",
    "profile.measure",
    "features.from_fit",
    "features.from_profile",
    "features.finish",
)
IN_PIECES = ("rowpipeline.add_rows", "rowpipeline.mean_rows", "forcemap.move", "profile.measure")
VECTORS = 100


def typecode_of(buffer):
    return buffer.typecode if isinstance(buffer, array) else "B"


def replay(name, calls):
    """Call a function on the micro:bit with recorded arguments: the first outcome that differs, or None."""
    for way in (*WAYS, *WAYS):  # what fits depends on timing, too: on a busy machine a second round is needed
        try:
            return replay_in(way, name, calls)
        except ScriptFailed as failure:
            if "MemoryError" not in str(failure):
                raise
    raise AssertionError(f"{name} does not fit into the micro:bit in any way")


def replay_in(way, name, calls):
    flat = Flattener()
    flat.add(name)
    buffers = {f"a{i}": a for i, a in enumerate(calls[0].before) if is_buffer(a)}
    kept: dict[str, list[int]] = {}
    with MicroBit() as bit:
        bit.load(flat, {n: (typecode_of(a), len(a)) for n, a in buffers.items()}, way)
        print(json.dumps({"function": name, "vectors": len(calls), "free bytes": bit.free_bytes()}))
        for index, call in enumerate(calls):
            words = [f"a{i}" if is_buffer(a) else str(int(a)) for i, a in enumerate(call.before)]
            for word, argument in zip(words, call.before, strict=True):
                if is_buffer(argument) and kept.get(word) != list(argument):
                    bit.put(word, list(argument), kept.get(word))
            said = bit.run(f"print(g.{flat.names[name]}({','.join(words)}))").strip()
            if said != str(call.returned):
                return index, said, call.returned
            for word, before, after in zip(words, call.before, call.after, strict=True):
                if is_buffer(after):
                    if (kept.get(word) != list(after) or before != after) and (
                        bit.check_sum(word) != digest(after)
                    ):
                        return index, word
                    kept[word] = list(after)
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


BINS = 8  # of a stroke's, whose rows fit into the micro:bit beside the code that works on them


def gathered(buffer, places, stride=1):
    """The numbers of some bins, in a buffer of the same kind."""
    numbers = [x for k in places for x in buffer[stride * k : stride * (k + 1)]]
    return array(buffer.typecode, numbers) if isinstance(buffer, array) else bytearray(numbers)


def some_bins(name, call, first):
    """The same call for a few bins alone, run on CPython; its rows must be those of the whole call."""
    bins = range(first, first + BINS)
    if name == "rowpipeline.mean_rows":
        sums, counts, slot, _, live, rows, total = call.before
        slots = [slot[k] for k in bins]
        here = (gathered(sums, slots, 16), gathered(counts, slots), bytearray(range(BINS)), BINS, live)
        before = (*here, gathered(rows, bins, 16), gathered(total, bins))
        rows_at = 5
    elif name == "rowpipeline.add_rows":
        *here, rows, base = call.before
        before = (*here, gathered(rows, [base // 16], 16), 0)
        assert call.after[6][base : base + 16] != rows[base : base + 16]
        bins, rows_at = range(base // 16, base // 16 + 1), 6
    elif name == "profile.measure":
        x, _, rows, depth, *there = call.before
        bins = range(first, first + 2 * BINS)
        before = (gathered(x, bins), 2 * BINS, gathered(rows, bins, 16), gathered(depth, bins), *there)
        rows_at = 2
    else:
        f, rows, at, *there = call.before
        bins, rows_at = range(at // 16, at // 16 + 1), 1
        before = (f, gathered(rows, bins, 16), 0, *there)
    after = copy.deepcopy(before)
    module, _, function = name.rpartition(".")
    returned = getattr(importlib.import_module(f"firmware_py.{module}"), function)(*after)
    if name != "profile.measure":
        assert after[rows_at] == gathered(call.after[rows_at], bins, 16)
    return Call(before, returned, after)


@pytest.mark.parametrize("name", STAGES)
def test_the_micro_bit_computes_each_stage_of_the_pipeline(name, calls):
    sizes = [len(a) for a in calls[name][0].before if is_buffer(a)]
    alike = [c for c in calls[name] if [len(a) for a in c.before if is_buffer(a)] == sizes]
    vectors = alike[:VECTORS]
    assert len(vectors) == VECTORS
    if name in IN_PIECES:
        vectors = [some_bins(name, call, k % 8) for k, call in enumerate(vectors)]
    assert replay(name, vectors) is None


EVALUATOR = ("standardise", "multiply", "predict", "doubt", "distance", "verdict")


@pytest.mark.parametrize("name", [f"evaluator.{name}" for name in EVALUATOR])
def test_the_micro_bit_computes_the_evaluators_steps_for_the_field_model(name, tables):
    """That model and all of `compute` together are more than its heap."""
    out = array("i", bytes(4 * evaluator.OUT_SIZE))
    with recorded(name) as calls:
        for vector in feature_vectors(VECTORS):
            tables["field"].evaluate(array("i", vector), out)
    assert len(calls[name]) == VECTORS
    assert replay(name, calls[name]) is None


def test_the_micro_bit_computes_a_whole_model_of_the_thesis_size(tables):
    """Features in, the five outputs with their intervals out."""
    out = array("i", bytes(4 * evaluator.OUT_SIZE))
    with recorded("evaluator.compute") as calls:
        for vector in feature_vectors(VECTORS):
            tables["thesis"].evaluate(array("i", vector), out)
    assert len(calls["evaluator.compute"]) == VECTORS
    assert replay("evaluator.compute", calls["evaluator.compute"]) is None
