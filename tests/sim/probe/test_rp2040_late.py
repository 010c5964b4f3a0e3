"""What makes a frame of the reference board late: commands, which it answers one after the other."""

import numpy as np
import pytest

from firmware_py import messages, status
from tests.sim.probe.board_bench import Board

pytestmark = [pytest.mark.board, pytest.mark.long, pytest.mark.timeout(0)]

CONTENT = messages.CONTENT_FRAMES | messages.CONTENT_STROKES
AROUND_US = 61_000
PERIOD_US = 20_000
BURSTS = (("stroke_ack",), 3 * ("stroke_ack",), 6 * ("stroke_ack",), 2 * ("statistics",))


def test_six_commands_at_once_make_a_frame_late_by_less_than_a_period():
    """The next one comes early, so that the rate stays."""
    board = Board().until_up()
    number = board.ask("stream_start", (CONTENT, 1, 0, 60_000)).fields["stream"]
    for names in BURSTS:
        board.run_us(AROUND_US)
        before, began_us = len(board.heard), board.chip.us
        sent = {board.send(name, (number, 1, 1) if name == "stroke_ack" else ()) for name in names}
        board.until(lambda: sent <= {m.number for m in board.heard[before:]})  # noqa: B023  at once
        took_us = board.chip.us - began_us
        board.run_us(AROUND_US)
        frames = [m.fields for m in board.heard[before:] if m.name == "frame"]
        apart_us = np.diff([frame["time_us"] for frame in frames])
        print(f"{len(names)} {names[0]}: {took_us / 1e3:.1f} ms; frames {apart_us} us apart", flush=True)
        assert apart_us.max() < 2 * PERIOD_US
    assert board.ask("stream_stop").code == status.OK
    counted = board.counters()
    assert counted["frames_overrun"] == counted["frames_dropped"] == 0
