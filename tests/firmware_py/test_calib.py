"""Calibration: what it takes out, what it stores, what it refuses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py import calib, status
from palpate.firmware_twin.replay_core import Replay
from palpate.sim.probe.sensors import Noise, SensorModel, pack, unpack


@given(st.binary(min_size=624, max_size=624))
@settings(max_examples=30)
def test_packing_is_lossless(packed):
    counts = unpack(packed)
    assert counts.max() < 4096
    assert pack(counts) == packed


def test_a_calibration_survives_the_store():
    c = calib.Calibration(5000)
    rng = np.random.default_rng(1)
    for i in range(calib.CELLS):
        c.offset[i] = int(rng.integers(0, 32768))
        c.gain[i] = int(rng.integers(0, 32768))
    c.set_dead([0, 25, 26, 300, 415])
    blob = c.to_bytes()
    assert len(blob) == calib.BLOB_BYTES
    other = calib.Calibration()
    assert other.load(blob) == status.OK
    assert other.to_bytes() == blob
    assert list(other.fill) == list(c.fill)


@pytest.mark.parametrize(
    ("at", "value", "code"),
    [
        (0, 0, status.BAD_VERSION),
        (1, 9, status.BAD_VERSION),
        (2, 8, status.BAD_PROBE),
        (7, 1, status.BAD_VALUE),
        (9, 200, status.BAD_VALUE),
    ],
)
def test_a_wrong_calibration_is_refused_and_changes_nothing(at, value, code):
    c = calib.Calibration()
    before = c.to_bytes()
    blob = bytearray(before)
    blob[at] = value
    assert c.load(bytes(blob)) == code
    assert c.load(before[:-1]) == status.BAD_LENGTH
    assert c.to_bytes() == before


def test_zeroing_takes_out_offsets_and_finds_cells_at_the_rails():
    c = calib.Calibration()
    total = [82 * 64 + (i % 7) * 64 for i in range(calib.CELLS)]
    total[5], total[100] = 0, 4095 * 64
    c.zero(total, 64)
    assert c.offset[8] == 8 * (82 + 1)
    assert [i for i in range(calib.CELLS) if c.dead[i >> 3] >> (i & 7) & 1] == [5, 100]
    assert list(c.fill) == [5, 4, 6, 100, 99, 101]


def test_dead_cells_are_filled_from_the_nearest_live_ones():
    c = calib.Calibration()
    c.set_dead([0, 1, 27, 28, *range(52, 78)])
    plan = {c.fill[i]: (c.fill[i + 1], c.fill[i + 2]) for i in range(0, c.fills, 3)}
    assert plan[0] == plan[1] == (2, 2)
    assert plan[27] == (26, 29)
    assert plan[60] == (34, 86)


def test_gain_and_offset_are_taken_out(fields):
    """A probe with 20 % gain spread, once calibrated, gives the features of a perfect one."""
    model = SensorModel(fields[0], Noise(), 1)
    spread = SensorModel(fields[0], Noise(gain=0.1, offset=0.005), 1)
    c = calib.Calibration()
    for i, (gain, offset) in enumerate(zip(spread.gain.ravel(), spread.offset_kPa.ravel(), strict=True)):
        c.gain[i] = round(calib.UNIT_GAIN / gain)
        c.offset[i] = round((offset + 0.5) / 25 * 4095 * 8)
    replay = Replay()
    replay.stream(model.stroke())
    perfect = replay.features()
    replay.stream(spread.stroke(), c)
    assert replay.features() == pytest.approx(perfect, abs=0.05)
