"""The models that come with Palpate, onto the reference board over its USB: each over another, often.

One of them goes onto an empty board in `make test`, too (test_rp2040.py).
"""

import pytest

from firmware_py import status
from palpate import models
from palpate.sim.probe.over_lump import strokes_over
from tests.firmware_py.talk import send_model
from tests.sim.probe.board_bench import Board, bundled, kept_files
from tests.sim.probe.board_copies import in_a_copy
from tests.sim.probe.board_terminal import streamed
from tests.sim.probe.heap import heap, leaves_room_while_it_streams

pytestmark = [pytest.mark.board, pytest.mark.long, pytest.mark.timeout(0)]

LUMP, MOMENTS = "d12h07e20f09", 40
TURNS = 20


@pytest.fixture(scope="module")
def hand():
    return strokes_over(LUMP, "typical", 1, MOMENTS, 1, press=True)


@pytest.fixture(scope="module")
def board(hand, public_key, tmp_path_factory):
    """It has a key and a calibration, and no model; what happens to it happens to copies."""
    kept = kept_files(tmp_path_factory.mktemp("store"), None, hand[1])
    return Board({"key.pub": public_key, **kept}).until_up()


def live(board):
    """Id of the board's model, and whether it is well."""
    identity = board.ask("identify", (7,)).fields
    return identity["model_id"], identity["model_status"]


def stroke(board, hand, palpate, folder):
    """One goes over the lump; its replay is identical, and while the next stream runs 40 kB are free."""
    board.stroke(hand[0], folder)
    (again,) = streamed(board, palpate, folder / "visit.mcap", 1)
    assert again.probe.as_dict()["lump"] is True
    board.stroke((), folder)
    leaves_room_while_it_streams(board)


@pytest.mark.parametrize("name", models.NAMES)
def test_each_comes_to_an_empty_board_and_the_next_one_over_it_right_after_a_stroke(
    board, hand, name, real_key_dir, palpate, tmp_path
):
    def work():
        names = models.NAMES
        for model in (name, names[(names.index(name) + 1) % len(names)]):
            image = bundled(model, real_key_dir)
            began_us = board.chip.us
            board.flash(image)
            print(f"{model}, {len(image)} bytes: live after {(board.chip.us - began_us) / 1e6:.1f} s")
            assert live(board) == (image[40:48], status.OK)
            folder = tmp_path / model
            folder.mkdir()
            stroke(board, hand, palpate, folder)

    in_a_copy(work)
    assert live(board) == (bytes(8), status.NO_MODEL)


def test_one_that_is_refused_leaves_the_live_one_at_work(board, hand, real_key_dir, palpate, tmp_path):
    def work():
        board.flash(bundled(models.ANYWHERE, real_key_dir))
        before = live(board)
        image = bytearray(bundled(models.FIELD, real_key_dir))
        image[-1] ^= 1
        name = send_model(board.ask, bytes(image))
        assert board.ask("flash_verify", (name,), limit_us=10e6).code == status.BAD_SIGNATURE
        assert live(board) == before and before[1] == status.OK
        stroke(board, hand, palpate, tmp_path)

    in_a_copy(work)


def test_twenty_in_a_row_leave_as_much_memory_as_one(board, hand, real_key_dir, palpate, tmp_path):
    def work():
        for turn in range(TURNS):
            image = bundled(models.NAMES[turn % len(models.NAMES)], real_key_dir)
            board.flash(image)
            assert live(board) == (image[40:48], status.OK)
            print(f"{turn + 1} of {TURNS}: {heap(board.chip)}", flush=True)
        stroke(board, hand, palpate, tmp_path)

    in_a_copy(work)
