"""The reference board where its start fails: it tells the host why, and tries again."""

import pytest

from firmware_py import messages
from palpate.sim.probe.rp2040 import flash
from palpate.sim.probe.rp2040.board_files import MAIN, PACK
from tests.sim.probe import board_bench
from tests.sim.probe.board_bench import Board

pytestmark = pytest.mark.board

WATCHDOG_US = 8e6
DAMAGED = "the probe does not start: ValueError: firmware.pack is damaged: copy it onto the probe again"


def damaged_pack():
    """One bit of one module is another."""
    pack = bytearray(board_bench.firmware()[PACK])
    pack[len(pack) // 2] ^= 8
    return bytes(pack)


def test_a_damaged_module_is_told_and_never_run_and_bootsel_gives_the_prompt():
    """The board stayed at MicroPython's prompt, or ran what the flipped bit made of the module."""
    board = Board({PACK: damaged_pack()})
    board.until(lambda: len(board.logs()) >= 2)
    assert set(board.logs()) == {DAMAGED}
    assert {fields["level"] for fields in board.named("log")} == {messages.LOG_ERROR}
    board.until(lambda: board.chip.resets == 1, 1.1 * WATCHDOG_US)
    print(f"tried again after {board.chip.us / 1e6:.1f} s")
    before = len(board.logs())
    board.until(lambda: len(board.logs()) > before)
    board.chip.bootsel.press()
    assert board.chip.execute("print(6 * 7)") == "42\n"
    board.chip.bootsel.release()
    board.chip.run_us(1.2 * WATCHDOG_US)
    assert board.chip.resets == 1, "at the prompt there is no watchdog"


def test_an_error_while_the_probe_starts_is_told():
    board = Board(blocks=flash.image({MAIN: board_bench.firmware()[MAIN]}))
    board.until(lambda: bool(board.logs()))
    assert board.logs()[0] == "the probe does not start: ImportError: no module named 'firmware_py'"


def test_a_start_that_hangs_is_begun_again():
    board = Board()
    board.chip.run_us(200_000)
    board.chip.hang()
    hung_us = board.chip.us
    board.until(lambda: board.chip.resets == 1, 1.1 * WATCHDOG_US)
    print(f"begun again {(board.chip.us - hung_us) / 1e6:.1f} s later")
    board.until(lambda: board.chip.connected)
