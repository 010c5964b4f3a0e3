"""The reference board's USB is pulled in the middle of a stroke and put in again."""

from itertools import pairwise

import pytest

from firmware_py import messages, status
from palpate.sim.probe import source
from palpate.sim.probe.hand import moments
from tests.host.conftest import bench
from tests.sim.probe.board_bench import Board, kept_files

__all__ = ["bench"]
pytestmark = [pytest.mark.board, pytest.mark.long]

CONTENT = messages.CONTENT_FRAMES | messages.CONTENT_STROKES
AWAY_US = 400_000


def test_the_probe_goes_on_with_the_stroke_and_tells_its_estimate_when_it_is_found_again(bench, tmp_path):
    strokes, calibration = bench
    way = moments(source.write_source(tmp_path / "way", strokes[:1]).read_bytes())
    (tmp_path / "store").mkdir()
    board = Board(kept_files(tmp_path / "store", calibration=calibration), way).until_up()
    began = board.ask("stream_start", (CONTENT, 1, 0, 60_000))
    assert began.code == status.OK
    number = began.fields["stream"]

    def told(state):
        return [fields for fields in board.named("stroke_state") if fields["state"] == state]

    board.until(lambda: bool(told(messages.STATE_STARTED)))
    before = len(board.named("frame"))
    board.chip.unplug()
    board.run_us(AWAY_US)
    assert len(board.named("frame")) == before
    board.chip.plug()
    board.chip.run(lambda: board.chip.connected)
    identity = board.ask("identify", (7,)).fields
    assert identity["boots"] == 1, "it was not restarted"
    assert board.ask("stream_renew", (number,)).code == status.OK
    board.until(lambda: bool(board.named("estimate")), 10e6)
    seqs = [fields["seq"] for fields in board.named("frame")]
    lost = sum(b - a - 1 for a, b in pairwise(seqs))
    (estimate,) = board.named("estimate")[:1]
    print(f"away for {AWAY_US / 1e6:g} s: {lost} frames lost, {estimate['frames']} in the stroke")
    assert 0 < lost <= 1.5 * AWAY_US / 20_000
    assert board.counters()["frames_overrun"] == 0
    assert estimate["first_seq"] <= seqs[before] and estimate["frames"] > 30
