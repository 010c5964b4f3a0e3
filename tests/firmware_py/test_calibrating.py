"""A calibration is refused where it would make the probe worse."""

import numpy as np
import pytest

from firmware_py import geometry, messages, status
from palpate.wire.packing import pack
from tests.firmware_py.talk import Bench

ZERO, GAIN = messages.CALIBRATE_ZERO, messages.CALIBRATE_GAIN
AIR = geometry.PEDESTAL_COUNTS


def record(counts) -> bytes:
    return bytes(8) + pack(np.broadcast_to(counts, geometry.CELLS).tolist())


@pytest.fixture
def calibrate(tmp_path):
    bench = Bench.measuring(tmp_path)

    def run(kind, counts, pressure_pa=0, frames=8):
        bench.probe.board.frames = counts if isinstance(counts, bytes) else record(counts)
        before = blob(bench)
        answer = bench.ask("calibrate", (kind, frames, pressure_pa), us=1_000_000)
        assert not bench.probe.board.streaming
        return answer.code, blob(bench) != before, answer.fields

    return run


def blob(bench):
    return b"".join(bench.ask("read_back", (0, at)).fields["tail"] for at in range(0, 1724, 200))


def test_the_zero_is_taken_in_the_air_only(calibrate):
    """It was taken in contact, and every pressure after it was too small by that much."""
    pressed = AIR + 4095 * 5 // 25  # 5 kPa
    assert calibrate(ZERO, pressed)[:2] == (status.IN_CONTACT, False)
    touched_for_one_frame = record(AIR) * 4 + record(pressed) + record(AIR) * 4
    assert calibrate(ZERO, touched_for_one_frame)[:2] == (status.IN_CONTACT, False)
    assert calibrate(ZERO, AIR + 20)[:2] == (status.OK, True)
    assert calibrate(ZERO, AIR)[:2] == (status.OK, True)


def test_a_gain_without_its_pressure_is_refused(calibrate):
    """Taken in the air it marked all 416 cells as dead."""
    assert calibrate(GAIN, AIR, 10_000)[:2] == (status.BAD_CALIBRATION, False)
    right = AIR + 4095 * 10 // 25
    code, changed, told = calibrate(GAIN, right, 10_000)
    assert (code, changed, told["dead_cells"]) == (status.OK, True, 0)


def test_a_cable_that_is_not_plugged_in_is_no_zero(calibrate):
    assert calibrate(ZERO, 0)[:2] == (status.BAD_CALIBRATION, False)


def test_a_few_broken_cells_are_found(calibrate):
    counts = np.full(geometry.CELLS, AIR + 4095 * 10 // 25)
    counts[[3, 77, 300]] = AIR
    code, changed, told = calibrate(GAIN, counts, 10_000)
    assert (code, changed, told["dead_cells"]) == (status.OK, True, 3)


@pytest.mark.parametrize("pressure_pa", [-1, 0, 25_100, 1_000_000, messages.WRAP - 1])
def test_a_pressure_that_the_cells_cannot_show_is_refused(calibrate, pressure_pa):
    assert calibrate(GAIN, AIR + 1000, pressure_pa)[:2] == (status.BAD_VALUE, False)
