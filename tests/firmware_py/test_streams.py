"""What a stream is: its number, its lease, its strokes, and whose the results are."""

import pytest

from firmware_py import messages, results, status
from firmware_py.estimator import Estimator
from firmware_py.store import FileStore
from palpate.sim.probe import source
from palpate.sim.probe.virtual import VirtualBoard
from tests.benchmarks.bench_link import Still
from tests.firmware_py.talk import Bench, command

FRAMES, STROKES = messages.CONTENT_FRAMES, messages.CONTENT_STROKES
SECOND = 1_000_000
AIR = source.lifted_record()
STROKE = AIR * 3 + source.records(Still(20)) + AIR * 3


@pytest.fixture
def bench(tmp_path):
    """A probe that strokes without end, two strokes a second, with a host beside it."""
    return Bench(VirtualBoard(STROKE), Estimator(FileStore(str(tmp_path))))


def start(bench, content=STROKES, strokes=0, lease_ms=0):
    answer = bench.ask("stream_start", (content, 1, strokes, lease_ms))
    assert answer.code == status.OK
    return answer.fields


def run_awake(bench, us):
    """Let time pass, with a word every second."""
    news = []
    while us > 0:
        bench.ask("time_sync")
        news += bench.run(min(us, SECOND))
        us -= SECOND
    return news


def of(news, name):
    return [m.fields for m in news if m.name == name]


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


def slow(tmp_path, bytes_per_s):
    board = VirtualBoard(STROKE, bytes_per_s=bytes_per_s, link_bytes=4096)
    return Bench(board, Estimator(FileStore(str(tmp_path))))


def add_up(bench):
    """The probe's counters of estimates."""
    told = dict(zip(messages.COUNTERS, bench.ask("statistics", us=SECOND).fields["tail"], strict=True))
    parts = [told["estimates_" + part] for part in ("acknowledged", "given_up", "waiting")]
    assert told["estimates"] == told["strokes"] == sum(parts)
    return told


def test_a_host_that_does_not_read_finds_the_newest_estimates(tmp_path):
    """90 s without a read lost 37 strokes while `results_replaced` said 67, most of which had arrived."""
    bench = slow(tmp_path, 1)
    bench.probe.board._bytes_per_s = 0
    begun = start(bench, FRAMES | STROKES, lease_ms=messages.LEASE_MOST_MS)
    bench.probe.board._bytes_per_s = 1
    run_silent(bench, 90 * SECOND)
    bench.probe.board._bytes_per_s = 100_000
    bench.run(5 * SECOND)
    bench.ask("stream_stop", us=SECOND)
    told = add_up(bench)
    came = [m["stroke"] for m in of(bench.heard, "estimate")]
    assert told["strokes"] > 80
    made = range(begun["next_stroke"], begun["next_stroke"] + told["strokes"])
    kept = [stroke for stroke in made if stroke in came]
    assert len(kept) >= 32
    lost = told["strokes"] - len(kept)
    assert told["estimates_given_up"] >= lost
    before_that = [s for s in kept if s <= made[-1] - 42]
    assert set(made[-30:]) <= set(kept), "the newest are there"
    assert len(before_that) <= 8, "and the oldest that the link's own buffers had taken"
    assert max(came.count(stroke) for stroke in kept) <= results.TRIES


def run_silent(bench, us):
    """The host says a word now and then, and reads nothing."""
    for k in range(us // SECOND):
        bench.probe.send(command("stream_renew", k, (1,)))
        bench.run(SECOND)


def test_a_slow_link_is_not_filled_with_repetitions(tmp_path):
    """20 kB/s for 15 s carried 1271 maps, one of them 584 times, and 8 estimates."""
    bench = slow(tmp_path, 20_000)
    start(bench, FRAMES | STROKES)
    run_silent(bench, 15 * SECOND)
    bench.ask("stream_stop", us=SECOND)
    told = add_up(bench)
    maps, estimates = ([m["stroke"] for m in of(bench.heard, kind)] for kind in ("map", "estimate"))
    assert set(range(1, told["strokes"] + 1)) <= set(estimates), "every estimate comes, late or not"
    assert max(maps.count(s) for s in set(maps)) <= results.TRIES
    assert max(estimates.count(s) for s in set(estimates)) <= results.TRIES
    assert len(of(bench.heard, "frame")) > 200, "and frames get their share"


def test_estimates_go_before_maps(tmp_path):
    bench = slow(tmp_path, 1)
    bench.probe.board._bytes_per_s = 0
    start(bench, lease_ms=messages.LEASE_MOST_MS)
    bench.probe.board._bytes_per_s = 1
    run_silent(bench, 20 * SECOND)
    bench.heard.clear()
    bench.probe.board._bytes_per_s = 100_000
    bench.ask("stream_stop", us=SECOND)
    bench.run(2 * SECOND)
    last = bench.probe.counter("strokes")
    late = [m for m in bench.heard if m.name in ("map", "estimate") and m.fields["stroke"] > last - 20]
    assert [m.name for m in late[:24]] == ["estimate"] * 20 + ["map"] * 4
    assert [m.fields["stroke"] for m in late[:20]] == list(range(last - 19, last + 1))


def test_repetitions_become_rarer_and_end(bench):
    start(bench, strokes=1)
    run_awake(bench, 60 * SECOND)
    estimates = [m for m in bench.heard if m.name == "estimate"]
    assert len(estimates) == results.TRIES
    assert bench.probe.counter("results_resent") == 3 * (results.TRIES - 1)
    assert bench.ask("results", (0,)).fields["waiting"] == 1, "it is kept, and can be asked for"


def campaign(tmp_path, bytes_per_s, stopped_s, seconds=180):
    """A stroke every 2.4 s, over such a link, whose host reads nothing in the middle; what came of it."""
    stroke = AIR * 3 + source.records(Still(114)) + AIR * 3
    board = VirtualBoard(stroke, bytes_per_s=bytes_per_s, link_bytes=4096)
    bench = Bench(board, Estimator(FileStore(str(tmp_path))))
    bench.ask("stream_start", (FRAMES | STROKES, 1, 0, messages.LEASE_MOST_MS), us=SECOND)
    came = {}

    def listen(span_s):
        for k in range(span_s):
            for m in of(bench.run(SECOND), "estimate"):
                if m["stroke"] not in came:
                    bench.probe.send(command("stroke_ack", m["stroke"], (m["stream"], m["stroke"], 7)))
                came[m["stroke"]] = came.get(m["stroke"], 0) + 1
            bench.probe.send(command("stream_renew", k, (bench.probe.firmware.stream.number,)))

    listen((seconds - stopped_s) // 2)
    if stopped_s:
        board._bytes_per_s = 1
        run_silent(bench, stopped_s * SECOND)
    board._bytes_per_s = bytes_per_s
    listen((seconds - stopped_s) // 2)
    bench.probe.send(command("stream_stop", 7))
    listen(20)
    maps = [m.fields["stroke"] for m in bench.heard if m.name == "map"]
    told = {name: bench.probe.counter(name) for name in messages.COUNTERS}
    waiting = bench.probe.firmware.results.waiting()
    assert told["estimates"] == told["estimates_acknowledged"] + told["estimates_given_up"] + waiting
    lost = told["strokes"] - len(came)
    assert lost <= told["estimates_given_up"]
    return {
        "kB/s": bytes_per_s // 1000, "not read s": stopped_s, "strokes": told["strokes"],
        "estimates": len(came), "lost": lost, "given up": told["estimates_given_up"],
        "one estimate at most": max(came.values()), "maps": len(maps),
        "one map at most": max(maps.count(k) for k in set(maps)),
        "frames": len(of(bench.heard, "frame")), "dropped": told["frames_dropped"],
    }  # fmt: skip


@pytest.mark.long
def test_slow_and_stopped_hosts(tmp_path):
    cases = [(rate, stop) for rate in (5_000, 20_000, 92_160) for stop in (0, 15, 30, 90)]
    for k, (rate, stop) in enumerate(cases):
        told = campaign(tmp_path / str(k), rate, stop)
        print(" | ".join(f"{name} {value}" for name, value in told.items()))
        if stop <= 15:
            assert told["lost"] == 0
        assert told["one map at most"] <= results.TRIES
        assert told["one estimate at most"] <= results.TRIES
