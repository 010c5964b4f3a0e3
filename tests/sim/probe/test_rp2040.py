"""The reference board: MicroPython's own port on an emulated RP2040, its circuit, and USB."""

import numpy as np
import pytest

from firmware_py import messages, status
from palpate.sim.probe import sensors
from palpate.sim.probe.rp2040 import flash
from palpate.sim.probe.rp2040.board_files import PACK
from palpate.sim.probe.rp2040.chip import SERIAL
from tests.sim.probe import board_bench
from tests.sim.probe.board_bench import Board

pytestmark = pytest.mark.board

RANDOM_CELLS = np.random.default_rng(3).integers(0, 4096, 416)
FRAMES_TRIED = 15
LEAST_FREE = 50_000  # without a model; with one: test_board_memory.py
FRAMES, STROKES = messages.CONTENT_FRAMES, messages.CONTENT_STROKES


def test_a_file_system_made_here_is_read_as_it_was_written():
    files = {"main.py": b"x" * 5000, "firmware_py/boards/scan.mpy": b"y", "key.pub": bytes(56)}
    assert flash.read(flash.image(files)) == files


@pytest.fixture(scope="module")
def prompt():
    """A board at MicroPython's prompt, the firmware's modules and the matrix within reach."""
    pack = board_bench.firmware()[PACK]
    board = board_bench.at_the_prompt(pack, cells=RANDOM_CELLS, displacement=1000)
    board.chip.execute(PREPARE)
    return board


PREPARE = """
import time
exec(open("loader.py").read())
from machine import Pin, unique_id
from firmware_py.boards import fast_scan, scan
fast_scan.install()
one = scan.Scan(Pin(2), Pin(17), Pin(16, Pin.IN), Pin(10))
counts = bytearray(624)
"""
MEASURE = """
began = time.ticks_us()
one.start()
started = time.ticks_us()
while not one.done():
    pass
done = time.ticks_us()
one.take(counts)
taken = time.ticks_us()
print(counts.hex(), one.displacement(), started - began, done - began, taken - done)
"""


def measured(board, settling_us):
    """Cells, displacement, and times in us, with amplifiers of that time constant."""
    board.matrix.settling_us = settling_us
    cells, displacement, *times = board.chip.execute(MEASURE).split()
    return sensors.unpack(bytes.fromhex(cells)), int(displacement), [int(time) for time in times]


def test_a_host_that_says_nothing_takes_nothing_of_the_processors_time(prompt):
    """Every question of the device was answered with an empty packet: loops took three times as long."""
    loop = "t = time.ticks_us()\nx = 0\nfor i in range(1000): x += i\nprint(time.ticks_us() - t)"
    assert int(prompt.chip.execute(loop)) < 15_000


def test_a_board_knows_its_flash_chips_number(prompt):
    assert prompt.chip.execute("print(unique_id().hex())").strip() == SERIAL.hex()


def test_an_empty_path_is_the_directory_that_mpremote_copies_into(prompt):
    """`mpremote fs cp ... :` asks for it. The prompt of tests/firmware_py/test_install.py had none there."""
    assert prompt.chip.execute("print(os.stat('')[0] == 0x4000, os.getcwd())") == "True /\n"


def test_the_state_machines_measure_every_cell_in_its_place_while_the_processor_does_something_else(prompt):
    cells, displacement, (start_us, scan_us, take_us) = measured(prompt, settling_us=1.5)
    assert np.array_equal(cells, RANDOM_CELLS)
    assert displacement == 2000
    assert scan_us < 10_000, "eighty-five frames a second leave 11.7 ms"
    assert start_us + take_us < 1000
    print(f"scan {scan_us} us in the background; to start it {start_us} us, to take it {take_us} us")


def test_amplifiers_that_are_too_slow_would_be_seen(prompt):
    assert not np.array_equal(measured(prompt, settling_us=6.0)[0], RANDOM_CELLS)


@pytest.fixture(scope="module")
def started():
    """A board without key or model, cells at random; it was waited for until it had said its first words."""
    board = Board(cells=RANDOM_CELLS, displacement=1000)
    board.hand.begin = board.hand.end = lambda *_: None  # nobody touches it
    board.until(lambda: bool(board.heard), 10e6)
    board.up_us = board.chip.us
    board.until(lambda: len(board.logs()) >= 3)
    return board


def test_it_starts_in_two_seconds_in_machine_code_and_says_what_is_missing(started):
    board = started
    code, memory, key = board.logs()[:3]
    print(f"up after {board.up_us / 1e6:.2f} s; {memory}")
    assert board.up_us < 2e6
    assert board.named("boot") == [{"boots": 1, "status": status.OK}]
    assert code == "machine code: link, frames, model, scan"
    assert int(memory.split()[1]) > LEAST_FREE, memory
    assert key.startswith("no public key: ")


def test_it_says_who_it_is_by_its_flash_chips_number(started):
    identity = started.ask("identify", (7,)).fields
    assert identity["serial"] == SERIAL
    assert identity["model_status"] == status.NO_KEY
    assert identity["boots"] == 1


def test_fifty_frames_a_second_arrive_whole_and_on_time_and_leave_the_heap_alone(started):
    board = started
    assert board.ask("stream_start", (FRAMES | STROKES, 1, 0, 60_000)).code == status.OK
    board.until(lambda: board.named("frame"), 2e6)
    counted = [board.counters(), board.counters()]
    before = len(board.named("frame"))
    board.until(lambda: len(board.named("frame")) >= before + FRAMES_TRIED, 2e6)
    counted.append(board.counters())
    assert board.ask("stream_stop").code == status.OK
    frames = board.named("frame")
    for frame in frames:
        assert np.array_equal(sensors.unpack(frame["tail"]).reshape(-1), RANDOM_CELLS)
        assert frame["displacement_um"] == pytest.approx(6105, abs=4)
    # while it answered the questions frames were up to 8 ms late, the one after them early
    apart_us = np.diff([frame["time_us"] for frame in frames[before + 3 :]])
    print(f"{len(frames)} frames, {apart_us.min()} to {apart_us.max()} us apart")
    assert apart_us == pytest.approx(20_000, abs=1500)
    for name in ("frames_overrun", "frames_dropped"):
        assert counted[-1][name] == 0, name
    taken = counted[1]["free_bytes"] - counted[2]["free_bytes"]
    print(f"{FRAMES_TRIED} frames and a question for the counters take {taken} bytes of the heap")
    assert taken < 100 * FRAMES_TRIED


def test_a_processor_that_hangs_is_restarted_by_the_watchdog_and_the_host_is_told(started):
    """Without a watchdog it hung until somebody pulled the plug."""
    board = started
    board.chip.hang()
    hung_us = board.chip.us
    board.until(lambda: board.chip.resets == 1, 20e6)
    reset_us = board.chip.us
    assert reset_us - hung_us < 8.1e6
    board.until(lambda: len(board.named("boot")) == 2, 5e6)
    print(
        f"reset after {(reset_us - hung_us) / 1e6:.1f} s, up {(board.chip.us - reset_us) / 1e6:.1f} s later"
    )
    assert board.named("boot")[1] == {"boots": 2, "status": status.OK}
    board.until(lambda: "the watchdog restarted the probe: it had hung for 8 s" in board.logs())
