"""What a stream is: its number, its lease, its strokes, and whose the results are."""

import pytest

from firmware_py import messages, results, status
from palpate.sim.probe.virtual import VirtualBoard
from tests.firmware_py.streaming import AIR, SECOND, STROKE, of, run_awake, start
from tests.firmware_py.talk import Bench, command

FRAMES, STROKES = messages.CONTENT_FRAMES, messages.CONTENT_STROKES


@pytest.fixture
def bench(tmp_path):
    """A probe that strokes without end, two strokes a second, with a host beside it."""
    return Bench.measuring(tmp_path, STROKE)


def test_every_stream_has_a_number_of_its_own_over_restarts_too(tmp_path):
    seen = []
    for boots in (1, 2, 1 << 14):
        board = VirtualBoard(STROKE)
        board.boots = boots
        bench = Bench(board)
        for _ in range(3):
            seen.append(start(bench)["stream"])
            bench.ask("stream_stop")
    assert len(set(seen)) == 9
    assert all(0 < number < messages.WRAP for number in seen)


def test_what_a_stream_tells_bears_its_number(bench):
    first = start(bench, strokes=1)
    news = run_awake(bench, 2 * SECOND)
    for name in ("stroke_state", "map", "features", "estimate", "stream_end"):
        assert {m["stream"] for m in of(news, name)} == {first["stream"]}, name
    second = start(bench)
    assert second["stream"] != first["stream"]
    assert second["next_stroke"] == first["next_stroke"] + 1


def test_results_of_an_earlier_stream_keep_quiet_until_they_are_asked_for(bench):
    """`stream --strokes 1` printed the stroke before it: its estimate was sent for ten seconds more."""
    first = start(bench, strokes=1)
    run_awake(bench, SECOND)
    second = start(bench)
    news = run_awake(bench, 5 * SECOND)
    assert {m["stream"] for m in of(news, "estimate")} == {second["stream"]}
    bench.ask("stream_stop")
    listed = bench.ask("results", (0,)).fields
    assert listed["tail"][:3] == (first["stream"], 1, 1)
    assert listed["waiting"] == bench.ask("statistics").fields["tail"][counter("estimates_waiting")]
    bench.ask("results", (first["stream"],))
    apart = [m for m in of(bench.run(SECOND), "estimate") if m["stream"] == first["stream"]]
    assert apart
    assert {m["stroke"] for m in apart} == {1}
    assert bench.ask("stroke_ack", (first["stream"], 1, messages.HAVE_ALL)).fields["missing"] == 0
    assert first["stream"] not in bench.ask("results", (0,)).fields["tail"][::3]


def test_another_host_is_not_sent_what_nobody_took(bench):
    start(bench, strokes=1)
    run_awake(bench, SECOND)
    bench.ask("identify", (1,))
    assert not of(bench.run(10 * SECOND), "estimate")
    assert bench.ask("results", (0,)).fields["waiting"] == 1


def counter(name):
    return messages.COUNTERS.index(name)


def test_a_client_that_goes_away_does_not_leave_the_probe_streaming(bench):
    """It streamed for ever."""
    begun = start(bench, FRAMES)
    assert begun["lease_ms"] == messages.LEASE_MS
    bench.run(messages.LEASE_MS * 1000 + SECOND)
    assert not bench.probe.board.streaming
    ends = of(bench.heard, "stream_end")
    assert [(e["stream"], e["reason"]) for e in ends] == [(begun["stream"], messages.END_LEASE)]
    assert ends[0]["next_seq"] == of(bench.heard, "frame")[-1]["seq"] + 1
    assert bench.probe.counter("leases_expired") == 1
    assert bench.ask("stream_renew", (begun["stream"],)).code == status.NOT_KNOWN
    assert not of(bench.run(SECOND), "frame")


def test_any_word_of_the_host_renews_the_lease_and_the_host_may_choose_it(bench):
    begun = start(bench, FRAMES, lease_ms=500)
    for _ in range(20):
        bench.run(400_000)
        assert bench.ask("stream_renew", (begun["stream"],)).fields["stream"] == begun["stream"]
    bench.run(600_000)
    assert not bench.probe.board.streaming
    for lease_ms in (1, 499, messages.LEASE_MOST_MS + 1, messages.WRAP - 1):
        assert bench.ask("stream_start", (FRAMES, 1, 0, lease_ms)).code == status.BAD_VALUE


def test_a_calibration_whose_host_went_away_ends_too(bench):
    bench.ask("set_setting", (0, 1000))  # one frame a second: 255 of them take four minutes
    bench.probe.board.frames = AIR
    bench.send(b"", us=0)
    bench.send(command("calibrate", 77, (messages.CALIBRATE_ZERO, 255, 0)))
    bench.run(messages.LEASE_MS * 1000 + 2 * SECOND)
    assert not bench.probe.board.streaming
    assert bench.ask("stream_start", (FRAMES, 1, 0, 0)).code == status.OK


def test_a_stop_ends_a_calibration(bench):
    bench.probe.board.frames = AIR
    bench.send(command("calibrate", 77, (messages.CALIBRATE_ZERO, 255, 0)))
    bench.ask("stream_stop")
    assert [m.code for m in bench.heard if m.name == "calibrate"] == [status.BAD_STATE]
    assert not bench.probe.board.streaming


@pytest.mark.parametrize("content", [FRAMES, STROKES, FRAMES | STROKES])
def test_so_many_strokes_are_so_many_whatever_is_sent(bench, content):
    """With frames alone the number was ignored."""
    begun = start(bench, content, strokes=2)
    news = run_awake(bench, 6 * SECOND)
    assert not bench.probe.board.streaming
    ends = of(news, "stream_end")
    assert [e["reason"] for e in ends] == [messages.END_STROKES]
    assert ends[0]["next_stroke"] == (begun["next_stroke"] + 2 if content & STROKES else 1)
    assert bool(of(news, "frame")) == bool(content & FRAMES)
    assert bool(of(news, "estimate")) == bool(content & STROKES)


def test_a_stroke_that_is_broken_off_leaves_no_gap_in_the_numbers(bench):
    start(bench)
    while not [m for m in of(bench.heard, "stroke_state") if m["state"] == messages.STATE_STARTED]:
        bench.run(20_000)
    stop = bench.ask("stream_stop").fields
    assert stop["next_stroke"] == 1
    assert start(bench, strokes=1)["next_stroke"] == 1
    assert {m["stroke"] for m in of(run_awake(bench, SECOND), "estimate")} == {1}


def test_unknown_strokes_are_not_acknowledged(bench):
    """Any number was answered with OK."""
    begun = start(bench, strokes=1)
    run_awake(bench, SECOND)
    stream = begun["stream"]
    for wrong in ((stream, 2), (stream + 1, 1), (0, 0), (messages.WRAP - 1, messages.WRAP - 1)):
        assert bench.ask("stroke_ack", (*wrong, messages.HAVE_ALL)).code == status.NOT_KNOWN
    for have in (0, 8, 255):
        assert bench.ask("stroke_ack", (stream, 1, have)).code == status.BAD_VALUE
    for have, missing in ((messages.HAVE_MAP, 6), (messages.HAVE_MAP, 6), (messages.HAVE_ALL, 0), (7, 0)):
        assert bench.ask("stroke_ack", (stream, 1, have)).fields["missing"] == missing


def test_repetitions_become_rarer_and_end(bench):
    start(bench, strokes=1)
    run_awake(bench, 60 * SECOND)
    estimates = [m for m in bench.heard if m.name == "estimate"]
    assert len(estimates) == results.TRIES
    assert bench.probe.counter("results_resent") == 3 * (results.TRIES - 1)
    assert bench.ask("results", (0,)).fields["waiting"] == 1, "it is kept, and can be asked for"
