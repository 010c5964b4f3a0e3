"""A model onto the reference board, over its USB."""

import hashlib

import pytest

from firmware_py import messages, status
from palpate.model_export.image_builder import inspect
from tests.host.conftest import bench, images, specs
from tests.sim.probe.board_bench import Board, kept_files

__all__ = ["bench", "images", "specs"]
pytestmark = [pytest.mark.board, pytest.mark.timeout(3600)]


def test_a_model_is_sent_verified_tried_and_live(images, public_key, tmp_path):
    """Piece by piece; the model that was there before stays until the new one is confirmed."""
    old, new = images
    board = Board({"key.pub": public_key, **kept_files(tmp_path, old)})
    board.until(lambda: bool(board.named("boot")), 10e6)
    assert board.named("boot")[0]["status"] == status.OK
    name = hashlib.sha256(new).digest()[:8]
    began_us = board.chip.us
    assert board.ask("flash_begin", (len(new), name)).code == status.OK
    for at in range(0, len(new), messages.FLASH_PIECE):
        piece = new[at : at + messages.FLASH_PIECE]
        assert board.ask("flash_data", (at,), piece).code == status.OK
    sent_us = board.chip.us
    before, after = (bytes.fromhex(inspect(image).model_id) for image in images)
    assert board.ask("identify", (7,)).fields["model_id"] == before
    assert board.ask("flash_verify", (name,), limit_us=10e6).fields["model_id"] == after
    verified_us = board.chip.us
    assert board.ask("flash_confirm", (after,)).code == status.OK
    identity = board.ask("identify", (7,)).fields
    assert identity["model_id"] == after and identity["model_status"] == status.OK
    print(
        f"{len(new)} bytes sent in {(sent_us - began_us) / 1e6:.1f} s, verified and tried in "
        f"{(verified_us - sent_us) / 1e6:.1f} s"
    )
