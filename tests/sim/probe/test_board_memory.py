"""The reference board with all that it can have: a public key, a live field model, a stream."""

import dataclasses

import pytest

from firmware_py import messages, settings, status
from palpate.model_export.exporter import export
from palpate.model_export.signing import keys
from palpate.sim.probe.over_lump import strokes_over
from tests.model_export import synthetic
from tests.model_export.flashing import a_force_map
from tests.sim.probe import board_bench
from tests.sim.probe.board_bench import Board
from tests.sim.probe.heap import LEAST_FREE

pytestmark = [pytest.mark.board, pytest.mark.long]

READY_US = 2e6
LUMP, MOMENTS = "d12h07e20f09", 40
RATE_MHZ = 85_000
CONTENT = messages.CONTENT_FRAMES | messages.CONTENT_STROKES


@pytest.fixture(scope="module")
def image(tmp_path_factory):
    """A signed field model, and the key that it is signed with."""
    folder = tmp_path_factory.mktemp("image")
    keys.generate(folder / "key")
    model = dataclasses.replace(synthetic.model("field"), force_map=a_force_map())
    return export(model, folder / "key", counter=1)[0], (folder / "key" / "public.key").read_bytes()


@pytest.fixture(scope="module")
def live(image, tmp_path_factory):
    """A board on which that model is live; its power has just come."""
    files = board_bench.kept_files(tmp_path_factory.mktemp("store"), image[0])
    return Board({**files, "key.pub": image[1]})


def test_with_a_live_model_it_is_ready_in_two_seconds_and_streams_with_40_kB_free(live, image):
    """It ended in a MemoryError when main.py grew by a few lines: 10 kB were free, in pieces."""
    board = live
    board.until(lambda: bool(board.heard), 10e6)
    first_us = board.chip.us
    board.until_up()
    ready_us = board.chip.us
    print(f"first word after {first_us / 1e6:.2f} s, ready after {ready_us / 1e6:.2f} s")
    assert board.logs()[0].startswith("starting: ")
    assert ready_us < READY_US
    identity = board.ask("identify", (7,)).fields
    assert identity["model_status"] == status.OK
    assert identity["model_id"] == image[0][40:48]
    assert board.ask("stream_start", (CONTENT, 1, 0, 60_000)).code == status.OK
    board.until(lambda: len(board.named("frame")) >= 10)
    free = board.counters()["free_bytes"]
    print(f"{free} bytes free while it streams; {board.logs()}")
    assert free > LEAST_FREE
    assert board.ask("stream_stop").code == status.OK


def test_eighty_five_frames_a_second_through_a_whole_stroke_none_late_or_dropped(live, tmp_path):
    """As many as the converter makes, with pipeline, estimate and USB."""
    board = live
    board.stroke(strokes_over(LUMP, "typical", 1, MOMENTS, press=False)[0], tmp_path)
    assert board.ask("set_setting", (settings.FRAME_RATE, RATE_MHZ)).code == status.OK
    before = board.counters()
    assert board.ask("stream_start", (CONTENT, 1, 1, 60_000)).code == status.OK
    board.until(lambda: bool(board.named("estimate")), 10e6)
    board.until(lambda: bool(board.named("stream_end")), 2e6)
    after = board.counters()
    seen = {
        name: after[name] - before[name] for name in ("frames_acquired", "frames_overrun", "frames_dropped")
    }
    print(f"{RATE_MHZ / 1000:g} frames a second: {seen}")
    assert seen["frames_acquired"] > RATE_MHZ / 1000 * MOMENTS / 37.5 * 0.9
    assert seen["frames_overrun"] == seen["frames_dropped"] == 0
