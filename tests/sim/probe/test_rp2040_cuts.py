"""The reference board's power is cut while a model that comes with Palpate is flashed: 200 times in all.

The board itself is flashed and started again: bootrom, MicroPython, littlefs, firmware, signature.
"""

import pytest

from tests.campaigns import counted
from tests.sim.probe import board_cuts
from tests.sim.probe.board_cuts import CUTS, OVERS

pytestmark = [pytest.mark.board, pytest.mark.long, pytest.mark.timeout(0)]

EACH = CUTS // len(OVERS)


@pytest.fixture(scope="module", params=OVERS)
def flashed(request, real_key_dir, tmp_path_factory):
    """What a board over this had, and what its flash chip was told while a model came."""
    return request.param, board_cuts.record(tmp_path_factory.mktemp("store"), real_key_dir, request.param)


def test_after_each_cut_it_starts_and_answers_with_the_old_model_or_the_new_one_whole(flashed):
    """On a board that had none: with none, or the new one."""
    over, record = flashed
    found = board_cuts.campaign(record, EACH, over)
    counted(f"over {over}: {found}")
    assert found["cuts"] == EACH
    assert found["lost"] == 0
    assert found["none" if record.old is None else "old"]
    assert found["starts emulated"] > 10


def test_a_start_reads_nothing_that_littlefs_cannot_reach(flashed):
    """So that cuts which agree in all that can be reached need one start."""
    _, record = flashed
    read = board_cuts.read_by(record.before)
    print(f"{len(read)} blocks read")
    assert read and read <= set(board_cuts.within_reach(record.before))
