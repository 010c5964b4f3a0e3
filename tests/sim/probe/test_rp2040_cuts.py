"""The reference board's power is cut while its flash chip erases and programs, as a model is flashed.

The board itself is flashed; each cut leaves its flash chip as the command in hand had left it, torn, and the
board is started from that: bootrom, MicroPython, littlefs, firmware, the signature's check.
"""

import os
from collections import Counter
from itertools import islice

import numpy as np
import pytest

from firmware_py import status
from palpate.model_export.image_builder import inspect
from tests.host.conftest import bench, images, specs
from tests.sim.probe.board_bench import Board, kept_files
from tests.sim.probe.flash_cuts import cut_short, of_command, states

__all__ = ["bench", "images", "specs"]
pytestmark = [pytest.mark.board, pytest.mark.long, pytest.mark.timeout(0)]

VARIABLE = "PALPATE_TEST_BOARD_CUTS"
CUTS = int(os.environ.get(VARIABLE, "60"))
TOLD = (status.OK, status.TRIAL_HUNG, status.REPAIRED)
"""What the start may find: nothing, a model that was being tried, one copy of a record torn."""
LAST = 6  # commands that write the record of which model is live: each is cut


@pytest.fixture(scope="module")
def flashed(images, public_key, tmp_path_factory):
    """The board's file system before, and what the flash chip was told while a second model came."""
    board = Board({"key.pub": public_key, **kept_files(tmp_path_factory.mktemp("store"), images[0])})
    board.until(lambda: bool(board.named("boot")), 10e6)
    before, changes = board.chip.files(), []
    board.chip.before_flash = lambda command: changes.append(of_command(command))
    board.flash(images[1])
    for _, after in states(before, [*changes, changes[-1]], {len(changes)}):
        assert after == board.chip.files(), "what was recorded is all that happened"
    return before, changes


def test_it_starts_again_with_a_whole_signed_model_old_or_new(flashed, images, public_key):
    before, changes = flashed
    random = np.random.default_rng(13)
    last = np.arange(len(changes) - LAST, len(changes))
    chosen = Counter([*last, *random.integers(len(changes) - LAST, size=CUTS - LAST)])
    known = [bytes.fromhex(inspect(image).model_id) for image in images]
    torn = [
        (k, cut_short(chip, changes[k], random))
        for k, chip in states(before, changes, set(chosen))
        for _ in range(chosen[k])
    ]
    found: Counter[str] = Counter()
    order = random.permutation(len(torn))  # whoever stops it early has tried some of everything
    for done, (k, chip) in enumerate(islice((torn[n] for n in order), CUTS), 1):
        board = Board(blocks=chip)
        board.until(lambda: bool(board.named("boot")), 20e6)  # noqa: B023  it is done before the next
        (boot,) = board.named("boot")
        assert boot["status"] in TOLD, (k, changes[k], board.logs())
        identity = board.ask("identify", (7,)).fields
        live = identity["model_id"]
        assert identity["model_status"] == status.OK and live in known, (k, changes[k])
        found["old" if live == known[0] else "new"] += 1
        found["told of it"] += boot["status"] != status.OK
        found["erasing" if changes[k].data is None else "programming"] += 1
        print(f"{done} of {CUTS} cuts, in {len(changes)} commands: {dict(found)}", flush=True)
    assert found["old"] + found["new"] == CUTS
    assert found["old"] and found["new"]
