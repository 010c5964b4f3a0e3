"""The reference board: MicroPython's own port on an emulated RP2040, its circuit, and USB.

One board with a key and a calibration is started once, and goes through most of these promises in their
order: the model that comes with Palpate is flashed onto it, works through a stroke and is there after a
restart, which is long: in `make test` test_rp2040_start.py has the watchdog.
"""

import os

import numpy as np
import pytest

from firmware_py import messages, status
from palpate.firmware_twin.replay_core import Replay
from palpate.link import emulated as notes
from palpate.link import emulator_model as emulator
from palpate.sim.probe import sensors
from palpate.sim.probe.over_lump import strokes_over
from palpate.sim.probe.rp2040 import flash
from palpate.sim.probe.rp2040.board_files import PACK
from palpate.sim.probe.rp2040.chip import SERIAL
from palpate.stroke.replay import replay
from tests.sim.probe import board_bench
from tests.sim.probe.board_bench import Board
from tests.sim.probe.board_terminal import terminal
from tests.sim.probe.heap import LEAST_FREE, leaves_room_while_it_streams

pytestmark = [pytest.mark.board, pytest.mark.timeout(3600)]  # a busy machine takes minutes a second

RANDOM_CELLS = np.random.default_rng(3).integers(0, 4096, 416)
FRAMES_TRIED = 15
FIRST_WORD_US = 1.2e6
RESTARTED_US = 2.2e6
"""On a file system that it has written itself; 2 s, wanted from power, are held by test_board_memory.py."""
LATE = 2
LATEST_ESTIMATE_US = 1e6
LUMP, MOMENTS = "d12h07e20f09", 40
LIFTED = 6
"""Frames in the air, where only one stroke comes."""
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


def test_what_micropython_has_written_is_read_again(prompt):
    """It makes another version of the file system of it; `emulate --store` found that one empty."""
    before = flash.read(prompt.chip.files())
    prompt.chip.execute("with open('kept', 'wb') as file: file.write(b'12345678')\nos.sync()")
    assert flash.read(prompt.chip.files()) == {**before, "kept": b"12345678"}


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
def bench():
    """A press and a stroke through real sensors, two of which hang; a calibration that knows the dead."""
    return strokes_over(LUMP, "real", 1, MOMENTS, 1, press=True)


@pytest.fixture(scope="module")
def started(bench, tmp_path_factory):
    """A board with a key and a calibration and no model, cells at random; it is up."""
    kept = board_bench.kept_files(tmp_path_factory.mktemp("store"), None, bench[1])
    board = Board({"key.pub": emulator.public_key(), **kept}, cells=RANDOM_CELLS, displacement=1000)
    board.hand.begin = board.hand.end = lambda *_: None  # nobody touches it
    return board.until_up()


def test_it_says_who_it_is_by_its_flash_chips_number(started):
    identity = started.ask("identify", (7,)).fields
    assert identity["serial"] == SERIAL
    assert identity["model_status"] == status.NO_MODEL
    assert identity["boots"] == 1


def test_it_runs_in_machine_code_and_says_how_much_memory_is_free(started):
    started.until(lambda: len(started.logs()) >= 3)
    first, code, memory = started.logs()[:3]
    assert first.startswith("starting: ")
    assert code == "machine code: link, frames, model, stroke, scan"
    assert int(memory.split()[1]) > LEAST_FREE, memory


@pytest.fixture(scope="module")
def flashed(started):
    """The same board, once the model that comes with Palpate has been sent to it."""
    image, began_us = emulator.image(), started.chip.us
    started.flash(image)
    took_s = (started.chip.us - began_us) / 1e6
    print(f"{len(image)} bytes sent, verified, tried and live in {took_s:.1f} s")
    return started


def test_a_model_that_comes_with_palpate_is_sent_verified_tried_and_live_on_a_board_without_one(flashed):
    """Each was refused: its image was read whole, and the board had no room for that."""
    identity, image = flashed.ask("identify", (7,)).fields, emulator.image()
    assert (identity["model_status"], identity["model_id"]) == (status.OK, image[40:48])


def test_fifty_frames_a_second_arrive_whole_and_on_time_and_leave_the_heap_alone(flashed):
    board = flashed
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
    # while it answers questions, before and after these, frames are up to 8 ms late, and the next ones early
    apart_us = np.diff([frame["time_us"] for frame in frames[before + 5 : before + FRAMES_TRIED]])
    print(f"{len(frames)} frames, {apart_us.min()} to {apart_us.max()} us apart")
    assert apart_us == pytest.approx(20_000, abs=1500)
    for name in ("frames_overrun", "frames_dropped"):
        assert counted[-1][name] == 0, name
    taken = counted[1]["free_bytes"] - counted[2]["free_bytes"]
    print(f"{FRAMES_TRIED} frames and a question for the counters take {taken} bytes of the heap")
    assert taken < 100 * FRAMES_TRIED


def test_a_stroke_goes_from_the_pins_to_an_estimate_and_its_replay_is_identical(
    flashed, bench, palpate, tmp_path
):
    """By the public commands: stream finds the board and records it, replay works it out once more."""
    here = Replay()
    here.stream(bench[0][0], bench[1])
    assert here.pipeline.stuck == 2
    flashed.stroke(bench[0], tmp_path, LIFTED)
    before = flashed.counters()
    visit = tmp_path / "visit.mcap"
    with terminal(flashed) as end:
        notes.leave(notes.Note(end.port, os.getpid(), LUMP, "rp2040"))
        code, said, wrong = palpate("stream", "--strokes", 1, "--record", visit, "--timeout", 3600)
        assert code == 0, wrong
    code, said, wrong = palpate("replay", visit)
    assert code == 0 and said.splitlines()[-1].startswith("replay: identical"), said + wrong
    (stroke,) = replay(visit)
    assert stroke.identical and stroke.features_equal
    assert stroke.probe.as_dict()["lump"] is True
    late_us = end.when_said("estimate")[0] - stroke.probe.time_us
    counted = flashed.counters()
    assert counted["frames_dropped"] == before["frames_dropped"]
    # while it answers a command, or clears its memory, a frame may come late by a period
    late = counted["frames_overrun"] - before["frames_overrun"]
    assert late <= LATE
    print(f"{late} frames late by a period, {stroke.probe.overrun} of them in the stroke")
    print(f"{stroke.probe.frames} frames; the estimate came {late_us / 1e6:.2f} s after the last of them")
    assert late_us < LATEST_ESTIMATE_US


def test_after_a_stroke_40_kB_are_free_while_it_streams_with_its_model_live(flashed):
    """Ten kB were free, in pieces, with a smaller model."""
    leaves_room_while_it_streams(flashed)


@pytest.mark.long
def test_a_processor_that_hangs_is_restarted_by_the_watchdog_in_machine_code_with_its_model_live(flashed):
    """Without a watchdog it hung until somebody pulled the plug; one that nobody feeds bites too early."""
    board = flashed
    assert board.ask("identify", (7,)).code == status.OK  # after a second at the signature it feeds it again
    board.chip.hang()
    hung_us = board.chip.us
    board.until(lambda: board.chip.resets == 1, 20e6)
    reset_us = board.chip.us
    assert 7.8e6 < reset_us - hung_us < 8.1e6, "it was fed until then"
    board.heard.clear()
    board.until(lambda: bool(board.heard), 10e6)
    first_us = board.chip.us - reset_us
    board.until_up()
    up_us = board.chip.us - reset_us
    board.until(lambda: len(board.logs()) >= 3)
    first, code, memory = board.logs()[:3]
    print(
        f"reset after {(reset_us - hung_us) / 1e6:.1f} s, first word {first_us / 1e6:.3f} s later, "
        f"ready {up_us / 1e6:.3f} s later; {memory}"
    )
    assert first.startswith("starting: ")
    assert first_us < FIRST_WORD_US
    assert up_us < RESTARTED_US
    assert board.named("boot") == [{"boots": 2, "status": status.OK}]
    assert code == "machine code: link, frames, model, stroke, scan"
    assert int(memory.split()[1]) > LEAST_FREE, memory
    board.until(lambda: "the watchdog restarted the probe: it had hung for 8 s" in board.logs())
    assert board.ask("identify", (7,)).fields["model_id"] == emulator.image()[40:48]
