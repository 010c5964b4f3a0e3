"""The press before a stroke: as exact as its reference, in range whatever comes, the same on MicroPython."""

import dataclasses
import struct
from array import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py import calib, feature_names, features, geometry, press, profile, status, stroke_state, stuck
from firmware_py import settings as probe_settings
from palpate.features import press_features
from palpate.firmware_twin import twin
from palpate.firmware_twin.replay_core import Replay
from palpate.model_export.vocabulary import ABSENT
from palpate.sim.probe.sensors import LEVELS, SensorModel
from palpate.wire.cells import PITCH_MM
from tests.firmware_py import checked_int, pipeline_features, press_float
from tests.micropython import run_micropython

OF_THE_PRESS = press_features.PLACES
LN_COUNTS = np.log(32e9 / (geometry.COUNT_MPA * geometry.PITCH_UM))
"""ln F in N/m, and this, is ln of an image's sum in Q5 counts."""


def pressed(rows, sides, depths_um, force):
    """The features in integers, and how good the press was; Q5 counts as of `Pipeline.look`."""
    one = press.Press()
    one.begin()
    for row, side, depth in zip(rows, sides, depths_um, strict=True):
        if one.due():
            one.add(checked_int.ints([*row, side]), int(depth))
    out = checked_int.ints([0] * features.COUNT)
    one.measure(one.kept, force, geometry.COUNT_MPA, out, checked_int.ints([0] * 64))
    return np.array(out)[OF_THE_PRESS] / 2**24, one.code


@st.composite
def presses(draw):
    """Images whose width and peak change with a rising force, well clear of the ends of what counts."""
    n = draw(st.integers(12, 32))
    low, high = draw(st.floats(0.14, 0.33)), draw(st.floats(0.84, 1.4))
    force = np.linspace(low, high, n) if draw(st.booleans()) else np.geomspace(low, high, n)
    full = draw(st.floats(1500, 30000))
    narrow, bend = draw(st.floats(1, 3)), draw(st.floats(-0.4, 0.4))
    place = np.linspace(-1, 1, geometry.ROWS)
    shape = 1 + np.outer(narrow + bend * np.log(force), 1 - place**2)
    rows = force[:, None] * full * shape / shape.mean(1, keepdims=True)
    rows += draw(st.floats(-0.1, 0.1)) * full * place
    depths = draw(st.floats(500, 9000)) * force ** draw(st.floats(0.4, 0.9))
    share = draw(st.floats(0.0, 1.2)) + draw(st.floats(-0.3, 0.3)) * np.log(force)
    return np.rint(rows), np.rint(share * rows.sum(1)), np.rint(depths), round(full * geometry.ROWS)


def with_sides(rows, share):
    """Images (n, cells) of these rows (n, 16), whose outer columns have this share (n) of their mean."""
    outer = int(4.5 / PITCH_MM)
    across = np.ones((len(rows), geometry.COLUMNS))
    across[:, :outer] = across[:, -outer:] = share[:, None]
    across[:, outer:-outer] = (geometry.COLUMNS - 2 * outer * share[:, None]) / (geometry.COLUMNS - 2 * outer)
    return (rows[:, :, None] * across[:, None]).reshape(len(rows), -1)


@given(presses())
@settings(max_examples=300, deadline=None)
def test_the_integers_say_what_float64_says(one):
    rows, sides, depths_um, force = one
    got, code = pressed(rows, sides, depths_um, force)
    middle = rows[:, (geometry.ROWS - profile.MIDDLE) // 2 :][:, : profile.MIDDLE].mean(1)
    counts = with_sides(rows / 32, sides / geometry.ROWS / middle) + calib.PEDESTAL / 8
    frames = press_float.curves(counts, depths_um / 1e3)
    assert frames[:, 0] + LN_COUNTS == pytest.approx(np.log(rows.sum(1)), abs=1e-2)
    wanted = press_float.at_parts(frames, np.log(force) - LN_COUNTS)
    assert code == press.GOOD
    assert got == pytest.approx(wanted, abs=1e-3)


@given(presses(), st.data())
@settings(max_examples=50, deadline=None)
def test_a_press_that_does_not_reach_from_a_quarter_to_all_of_the_force_counts_as_none(one, data):
    rows, sides, depths_um, force = one
    part = rows.sum(1) / force
    missing = data.draw(st.sampled_from([part > 0.36, part < 0.7, np.arange(len(part)) < 5]))
    got, code = pressed(rows[missing], sides[missing], depths_um[missing], force)
    assert code in (press.NARROW, press.FEW)
    assert (got == ABSENT).all()


@pytest.mark.parametrize("n", [1, 31, 32, 33, 64, 65, 500])
def test_of_a_long_press_frames_are_kept_evenly_from_its_first_to_its_end(n):
    one = press.Press()
    one.begin()
    for k in range(n):
        if one.due():
            one.add(checked_int.ints([1000] * (geometry.ROWS + 1)), 1000 + k)
    seen = (
        np.rint(np.exp(np.array(one.kept[1 : press.KEPT * one.n : press.KEPT]) / 2**24) * 1e3).astype(int)
        - 1000
    )
    step = np.diff(seen)
    assert seen[0] == 0 and (step == step[:1]).all()
    assert one.n <= press.MOST and (n < 32 or one.n >= press.MOST // 2)
    assert n - 1 - seen[-1] < max(1, *step, 0)


def test_no_frames_whatever_lead_out_of_range():
    """Nor do whatever cells that hang."""
    watched, watch = checked_int.load((*twin.STAGES, "hanging"))
    rng = np.random.default_rng(3)
    for k in range(60):
        one = watched.press.Press()
        one.begin()
        size = int(rng.choice([1, 300, 20_000, 131_071]))
        for _ in range(int(rng.integers(1, 90))):
            if one.due():
                shape = (
                    rng.integers(-size, size + 1, geometry.ROWS) if k % 3 else np.full(geometry.ROWS, size)
                )
                one.add(
                    checked_int.ints([*shape, rng.integers(-16 * size, 16 * size + 1)]),
                    int(rng.integers(-131_071, 131_072)),
                )
        out = checked_int.ints([0] * features.COUNT)
        force, unit = int(rng.integers(1, 16 * size + 1)), int(rng.choice([1, 6105, (1 << 24) - 1]))
        one.measure(one.kept, force, unit, out, checked_int.ints([0] * 64))
        assert all(abs(v) < 2**29 for v in out)
        total = int(rng.integers(1, stuck.MOST + 1))
        hung = np.column_stack([rng.integers(0, calib.CELLS, total), rng.integers(0, 32_761, total)])
        own = calib.Calibration()
        own.offset[:] = array("H", rng.choice([0, 655, 32767], calib.CELLS).tolist())
        own.gain[:] = array("H", rng.choice([8192, 32767], calib.CELLS).tolist())
        cells = checked_int.ints(rng.choice([0, 4096, 5000, 65535], calib.CELLS))
        mended = checked_int.ints([0] * len(one.kept))
        given = checked_int.ints(hung.ravel()), own, cells, 0, force, mended
        watched.hanging.mend(one.kept, one.n, *given)
        one.measure(mended, force, unit, out, checked_int.ints([0] * 64))
        assert all(abs(v) < 2**29 for v in out)
    assert watch.most > 2**26


def touched(stream):
    """The same stroke from the frame on in which the probe notices the contact."""
    state = stroke_state.StrokeState(probe_settings.Settings().values)
    first = next(k for k, packed in enumerate(stream.packed) if state.in_contact(packed))
    return dataclasses.replace(
        stream,
        packed=stream.packed[first:],
        counts=stream.counts[first:],
        positions_um=stream.positions_um[first:],
        displacements_um=stream.displacements_um[first:],
        press=stream.press - first,
    )


def test_a_strokes_press_is_felt_by_the_whole_chain(fields, map_blob, fitted_map):
    fast, plain = Replay(map_blob), Replay(map_blob, plain=True)
    watched, _ = checked_int.load()
    for k, (level, frames) in enumerate((("none", 24), ("typical", 24), ("poor", 32))):
        model = SensorModel(fields[k], LEVELS[level], k)
        stream = touched(model.stroke(press=frames))
        frames = stream.press
        assert fast.stream(stream, model.calibration()) == status.OK
        counts, depths = stream.counts[:frames], stream.displacements_um[:frames] / 1e3
        true = pipeline_features.compute(
            stream.counts[frames:],
            stream.positions_um[frames:] / 1e3,
            stream.displacements_um[frames:] / 1e3,
            model.calibration(),
            fitted_map,
            press=(counts, depths),
        )
        wanted = [true.features[name] for name in press_features.NAMES]
        assert fast.features()[OF_THE_PRESS] == pytest.approx(wanted, abs=2e-3)
        share = fast.features()[feature_names.NAMES.index("base_share")]
        assert share == pytest.approx(true.features["base_share"], abs=2e-3)
        assert plain.stream(stream, model.calibration()) == status.OK
        assert list(plain.pipeline.features) == list(fast.pipeline.features)
        slow = watched.pipeline.Pipeline(model.calibration(), once=True)
        slow.begin_press()
        for packed, depth in zip(stream.packed[:frames], stream.displacements_um):
            slow.add_press(packed, int(depth))
        kept = press.KEPT * frames
        assert list(slow.press.kept[:kept]) == list(fast.pipeline.press.kept[:kept])


def test_without_a_press_nothing_else_changes_and_a_later_stroke_has_none(fields, replay):
    with_it = SensorModel(fields[1], LEVELS["none"], 1).stroke(press=24)
    replay.stream(with_it)
    first = replay.features()
    replay.stream(SensorModel(fields[1], LEVELS["none"], 1).stroke())
    second = replay.features()
    assert (second[OF_THE_PRESS] == ABSENT).all()
    assert (first[OF_THE_PRESS] > -5).all()
    others = np.delete(np.arange(features.COUNT), np.arange(features.COUNT)[OF_THE_PRESS])
    assert np.array_equal(first[others], second[others])


SCRIPT = """
import micropython, struct
from firmware_py import calib, pipeline
calibration = calib.Calibration()
calibration.load(open("calibration", "rb").read())
p = pipeline.Pipeline(calibration, once=True)
f = open("strokes", "rb")

def feed(frames):
    micropython.heap_lock()
    code = 0
    for place, packed in frames:
        code |= p.add_press(packed, place[1])
    micropython.heap_unlock()
    return code

for _ in range(3):
    n, press = struct.unpack("<ii", f.read(8))
    frames = [(struct.unpack("<ii", f.read(8)), f.read(624)) for _ in range(n)]
    p.begin_press()
    assert feed(frames[:press]) == 0
    p.reset()
    for (x, d), packed in frames[press:]:
        p.add_frame(packed, x, d)
    print(p.finish(), p.press.code, p.stuck, *p.features)
"""


def test_on_micropython_the_same_integers_and_nothing_allocated_while_pressing(fields):
    replay, calibration = Replay(), calib.Calibration()
    calibration.set_dead([3, 77, 78, 400])
    raw, expected = b"", []
    for k, frames in enumerate((24, 80, 4)):
        noise = LEVELS["typical"].with_(stuck=0.01 * k)
        stream = touched(SensorModel(fields[k], noise, k).stroke(40, press=frames))
        frames = stream.press
        raw += struct.pack("<ii", len(stream.packed), frames)
        for packed, x, d in zip(stream.packed, stream.positions_um, stream.displacements_um):
            raw += struct.pack("<ii", int(x), int(d)) + packed
        code = replay.stream(stream, calibration)
        p = replay.pipeline
        expected.append([code, p.press.code, p.stuck, *p.features])
    said = run_micropython(SCRIPT, {"strokes": raw, "calibration": calibration.to_bytes()})
    assert [[int(v) for v in line.split()] for line in said.splitlines()] == expected
    assert [line[1] for line in expected] == [press.GOOD, press.GOOD, press.FEW]
    assert min(line[2] for line in expected) > 3, "cells that hang"
