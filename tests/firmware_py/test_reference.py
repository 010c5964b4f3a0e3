"""A reference press: nothing is allocated for a frame, no integer leaves its range, one answer everywhere."""

from __future__ import annotations

import struct
from array import array

import numpy as np
import pytest

from firmware_py import calib, feature_names, features, reference, stage, status
from firmware_py import pipeline as pipelines
from palpate.firmware_twin.replay_core import Replay
from palpate.learn.reference import features_of
from palpate.model_export.integers import compiler
from palpate.sim.probe.sensors import LEVELS, SensorModel, StrokeField
from tests import reference_model
from tests.firmware_py import checked_int
from tests.firmware_py.strokes import read_strokes
from tests.micropython import run_micropython

OF_THE_PRESS = slice(features.PRESS, features.PRESS + 9)


@pytest.fixture(scope="module")
def stream():
    field = StrokeField(*read_strokes()[1])
    return SensorModel(field, LEVELS["typical"], 4).reference(field, field.middle_N_per_m)


def test_places_in_the_vector_are_those_of_their_names():
    assert feature_names.NAMES[stage.LN_FORCE] == "ln_force"
    assert stage._PRESS == features.PRESS


def test_zero_and_drift_of_the_sensors_are_taken_out(stream):
    """With an offset that grows all the while, the press is the one without."""
    field = StrokeField(*read_strokes()[1])
    still = SensorModel(field, LEVELS["none"], 4)
    drifting = SensorModel(field, LEVELS["none"].with_(drift=0.002, displacement_drift_mm=0.1), 4)
    replay = Replay()
    (good, wanted), (code, got) = (
        features_of(m.reference(field, field.middle_N_per_m), replay) for m in (still, drifting)
    )
    assert good == code == status.OK
    assert got[OF_THE_PRESS] == pytest.approx(wanted[OF_THE_PRESS], abs=0.02)
    assert got[stage.LN_FORCE] == pytest.approx(wanted[stage.LN_FORCE], abs=0.002)


def test_no_number_leaves_its_range_whatever_press_and_reference_say():
    modules, watch = checked_int.load(("scales", "stage"))
    most = 0x1FFFFFFF
    refers = array("i", [1 << 14] * 3 + [32767, -32767, 32767, 32767, -32767, 32767, 1 << 29])
    ends = array("i", [-(32 << 24) + 1, (32 << 24) - 1] * 3)
    rng = np.random.default_rng(1)
    for _ in range(300):
        x = array("i", rng.integers(-most, most, features.COUNT + 3).tolist())
        held = array("i", rng.integers(-most // 2, most // 2, 3).tolist())
        for k in range(3):
            x[features.COUNT + k] //= 2
        x[stage.LN_FORCE] //= 8
        modules.stage.join(x, features.COUNT, held, refers, ends)
    assert watch.most > 1 << 28


SCRIPT = """
import micropython, struct
from firmware_py import calib, geometry, pipeline, press, reference, stage
from array import array
p = pipeline.Pipeline(calib.Calibration())
taking = reference.Taking(p)
f = open("frames", "rb")
code = None
size = 9 + geometry.FRAME_BYTES
while code is None:
    raw = f.read(size)
    touches, x, d = struct.unpack_from("<Bii", raw)
    packed = raw[9:]
    last = taking._after[-1] == 15
    if not last:
        micropython.heap_lock()
    code = taking.take_reference(packed, bool(touches), x, d)
    if not last:
        micropython.heap_unlock()
print(code, *p.features)
"""


def test_on_micropython_the_same_integers_and_not_one_byte_for_a_frame(stream):
    plain = pipelines.Pipeline(calib.Calibration())
    taking = reference.Taking(plain)
    raw, code = b"", None
    for k, (packed, x, d) in enumerate(zip(stream.packed, stream.positions_um, stream.displacements_um)):
        touches = 40 <= k < len(stream.packed) - 48
        raw += struct.pack("<Bii", touches, x, d) + packed
        if code is None:
            code = taking.take_reference(packed, touches, int(x), int(d))
    assert code == status.OK
    told = run_micropython(SCRIPT, {"frames": raw})
    assert [int(v) for v in told.split()] == [status.OK, *plain.features]


def test_a_reference_of_the_same_place_moves_the_estimates_half_way():
    first = compiler.compile_first(reference_model.model().first)
    at = features.COUNT
    x = array("i", [0] * features.COUNT)
    for k, centre in enumerate(reference_model.CENTRE):
        x[features.PRESS + k] = int(centre * (1 << 24))
    x[stage.LN_FORCE] = 4 << 24
    own = list(first.extend(x)[at:])
    step = 1 << 20
    first.set(own[0] - (4 << 24) + step, own[1] - step, own[2])
    seen = first.extend(x)
    assert first.refer(seen) == 64
    assert [seen[at + k] - own[k] for k in range(3)] == pytest.approx([step / 2, -step / 2, 0], abs=600)
    first.set(own[0] - (4 << 24) + 8 * step, own[1], own[2])
    seen = first.extend(x)
    assert first.refer(seen) == 128
    assert list(seen[at:]) == own
