"""The encoder's two drivers on the emulated board: a PIO program, and the pins' interrupts."""

import numpy as np
import pytest

from palpate.sim.probe.rp2040.board_files import FIRMWARE, MAIN, compiled
from palpate.sim.probe.rp2040.wiring import A, B
from tests.sim.probe.board_bench import Board

pytestmark = [pytest.mark.board, pytest.mark.timeout(3600)]

CYCLE = ((0, 0), (1, 0), (1, 1), (0, 1))  # A, B
MODULES = "encoder", "pio_encoder"
PREPARE = f"""
import rp2
import sys
from machine import Pin
from firmware_py.boards import encoder, pio_encoder

def pins():
    return Pin({A}, Pin.IN, Pin.PULL_UP), Pin({B}, Pin.IN, Pin.PULL_UP)
"""
OTHER_PROGRAM = """
@rp2.asm_pio()
def other():
    nop()

rp2.PIO(0).remove_program()
rp2.PIO(0).add_program(other)
del sys.modules["firmware_py.boards.pio_encoder"]  # it knows where its program lay
import firmware_py.boards.pio_encoder
from firmware_py.boards import pio_encoder
"""
CLASSES = {"pio": "pio_encoder.PioEncoder", "interrupts": "encoder.Encoder"}
FASTEST_US = {"pio": 12, "interrupts": 250}  # 2 m/s; 100 mm/s


class Wheel:
    """Turns the encoder on the board's pins, a quarter step at a time."""

    def __init__(self, board):
        self._chip = board.chip
        self._pins = board.chip.mcu.gpio[A], board.chip.mcu.gpio[B]
        self._at = self._left = 0
        self._tick = board.chip.mcu.clock.create_alarm(self._step)

    def turn(self, steps, step_us):
        """Turn, and wait until the board has seen the last step."""
        self._left, self._step_ns = steps, 1000 * step_us
        self._tick.schedule(self._step_ns)
        self._chip.run(lambda: not self._left)
        self._chip.run_us(500)

    def jump(self):
        """Both pins change at once."""
        self._at += 2
        self._show()
        self._chip.run_us(500)

    def _step(self):
        if self._left:
            way = 1 if self._left > 0 else -1
            self._at += way
            self._left -= way
            self._show()
            self._tick.schedule(self._step_ns)

    def _show(self):
        for pin, level in zip(self._pins, CYCLE[self._at % 4], strict=True):
            pin.set_input_value(level)


class Bench:
    """A board at MicroPython's prompt with one encoder, and its wheel."""

    def __init__(self):
        files = {MAIN: b"", "firmware_py/__init__.py": b"", "firmware_py/boards/__init__.py": b""}
        for name in MODULES:
            source = (FIRMWARE / "boards" / f"{name}.py").read_text()
            files[f"firmware_py/boards/{name}.mpy"] = compiled(name, source)
        self.board = Board(files)
        self.board.chip.run(lambda: self.board.chip.connected)
        self.board.chip.execute(PREPARE)
        self.wheel = Wheel(self.board)

    def make(self, maker):
        """Make the encoder `one`, of 25 um a step, where the wheel is now."""
        self.board.chip.execute(f"one = {maker}(*pins(), 25)")

    def told(self):
        """Position in um, and how many edges were missed."""
        position_um, missed = self.board.chip.execute("print(one.position_um(), one.missed)").split()
        return int(position_um), int(missed)


@pytest.fixture(scope="module")
def bench():
    return Bench()


@pytest.mark.parametrize("kind", CLASSES)
def test_it_follows_every_turn_wherever_it_began(bench, kind):
    random = np.random.default_rng(1)
    for began in range(4):
        bench.wheel.turn(1, 250)
        bench.make(CLASSES[kind])
        at = 0
        for steps in random.integers(-60, 60, 3).tolist():
            bench.wheel.turn(steps, FASTEST_US[kind])
            at += steps
            assert bench.told() == (25 * at, 0), began
        bench.board.chip.execute("one.zero()")
        bench.wheel.turn(-3, 250)
        assert bench.told() == (-75, 0)


@pytest.mark.parametrize("kind", CLASSES)
def test_what_changed_twice_between_two_looks_is_counted_as_missed(bench, kind):
    bench.make(CLASSES[kind])
    bench.wheel.jump()
    assert bench.told()[1] == 1


def test_pio_counts_thousands_of_steps_while_nobody_looks(bench):
    bench.make(CLASSES["pio"])
    bench.wheel.turn(4000, FASTEST_US["pio"])
    bench.wheel.turn(-1000, FASTEST_US["pio"])
    assert bench.told() == (25 * 3000, 0)


def test_pio_says_so_where_edges_come_faster_than_it_looks(bench):
    bench.make(CLASSES["pio"])
    bench.wheel.turn(2000, 4)
    position_um, missed = bench.told()
    assert position_um != 25 * 2000
    assert missed > 100


def test_where_the_block_has_no_room_the_pins_interrupts_count(bench):
    bench.make("pio_encoder.best")
    assert bench.board.chip.execute("print(type(one).__name__)").strip() == "PioEncoder"
    bench.board.chip.execute(OTHER_PROGRAM)
    bench.make("pio_encoder.best")
    assert bench.board.chip.execute("print(type(one).__name__)").strip() == "Encoder"
    bench.wheel.turn(4, 250)
    assert bench.told() == (100, 0)
