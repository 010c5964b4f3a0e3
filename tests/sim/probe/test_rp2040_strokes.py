"""Twenty strokes in a row on one reference board: every estimate comes, no frame is lost, memory stays."""

import pytest

from firmware_py import messages, status
from palpate.link import emulator_model as emulator
from palpate.sim.probe.over_lump import strokes_over
from tests.sim.probe.board_bench import Board, kept_files
from tests.sim.probe.board_terminal import streamed

pytestmark = [pytest.mark.board, pytest.mark.long, pytest.mark.timeout(0)]

LUMP, MOMENTS = "d12h07e20f09", 40
VISITS = (1, 1, 3, 5, 10)
"""Strokes in each stream: after each the heap and the counters are looked at."""
FRAMES, LATE = 500, 0.01
"""Frames in all at least, and what share of them may be late by a period."""


@pytest.fixture(scope="module")
def strokes():
    """Of one lump by different hands, and the calibration of the probe."""
    return strokes_over(LUMP, "typical", 1, MOMENTS, sum(VISITS), press=False)


def free_bytes(board, folder):
    """Of its heap, just after a stream has ended, which clears it of what nobody needs any more."""
    board.stroke((), folder)
    for name, values in (("stream_start", (messages.CONTENT_STROKES, 1, 0, 60_000)), ("stream_stop", ())):
        assert board.ask(name, values).code == status.OK
    return board.counters()["free_bytes"]


def test_every_estimate_comes_its_replay_is_identical_no_frame_is_lost_and_the_heap_is_as_it_was(
    strokes, palpate, tmp_path, capsys
):
    made, calibration = strokes
    (tmp_path / "store").mkdir()
    files = kept_files(tmp_path / "store", emulator.image(), calibration)
    board = Board({"key.pub": emulator.public_key(), **files}).until_up()
    free, estimates = [], []
    for visit in VISITS:
        some = made[len(estimates) : len(estimates) + visit]
        board.stroke(some, tmp_path)
        recording = tmp_path / f"visit-{len(estimates)}.mcap"
        again = streamed(board, palpate, recording, visit)
        code, said, wrong = palpate("replay", recording)
        assert code == 0 and said.splitlines()[-1].startswith("replay: identical"), said + wrong
        estimates += [stroke.probe for stroke in again]
        counted = board.counters()
        free.append(free_bytes(board, tmp_path))
        with capsys.disabled():
            print(
                f"{len(estimates)} strokes: {counted['frames_acquired']} frames, "
                f"{counted['frames_sent']} sent, {counted['frames_dropped']} dropped, "
                f"{counted['frames_overrun']} overrun; "
                f"{free[-1]} bytes of the heap free; {[estimate.reason for estimate in estimates]}",
                flush=True,
            )
    assert all(estimate.reason == "ok" for estimate in estimates)
    assert counted["frames_sent"] > FRAMES
    assert counted["frames_dropped"] == 0
    assert counted["frames_overrun"] < LATE * counted["frames_acquired"]
    assert set(free) == {free[0]}
