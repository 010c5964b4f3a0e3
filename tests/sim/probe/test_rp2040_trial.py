"""A model in whose trial the reference board hangs: the watchdog ends it, and the model it had stays."""

import pytest

from firmware_py import live_model, messages, status
from palpate.model_export.image_builder import inspect
from palpate.sim.probe.rp2040 import flash
from tests.firmware_py.talk import send_model
from tests.host.conftest import bench, images, specs
from tests.sim.probe.board_bench import Board, kept_files
from tests.sim.probe.flash_cuts import of_command

__all__ = ["bench", "images", "specs"]
pytestmark = [pytest.mark.board, pytest.mark.long]


def test_a_board_that_hangs_while_it_tries_a_model_comes_back_with_the_old_one_and_says_so(
    images, public_key, tmp_path
):
    """The processor is stopped between the commands that write and remove the file `trial`."""
    old, new = images
    before, after = (bytes.fromhex(inspect(image).model_id) for image in images)
    board = Board({"key.pub": public_key, **kept_files(tmp_path, old)}).until_up()
    name = send_model(board.ask, new)
    told = []

    def watch(command: bytes) -> None:
        told.append(of_command(command).data)

    board.chip.before_flash = watch
    number = board.send("flash_verify", (name,))
    board.until(lambda: any(data and after in data for data in told), 10e6)
    while live_model.TRIAL not in flash.read(board.chip.files()):
        board.chip.run_us(100)
    assert not [m for m in board.heard if m.number == number], "it is still trying"
    board.chip.hang()
    hung_us = board.chip.us
    board.until(lambda: board.chip.resets == 1, 20e6)
    board.until(lambda: len(board.named("boot")) == 2, 10e6)
    print(f"hung at {hung_us / 1e6:.2f} s, up again {(board.chip.us - hung_us) / 1e6:.1f} s later")
    assert board.named("boot")[1] == {"boots": 2, "status": status.TRIAL_HUNG}
    identity = board.ask("identify", (7,)).fields
    assert identity["model_id"] == before and identity["model_status"] == status.OK
    assert identity["damage"] & messages.DAMAGE_TRIAL_HUNG
    board.until(lambda: "the watchdog restarted the probe: it had hung for 8 s" in board.logs())
    kept = flash.read(board.chip.files())
    assert live_model.TRIAL not in kept
    assert old in kept.values()
