"""Hosts that read slowly or not at all: the newest and what matters go first, and every loss is counted."""

import numpy as np
import pytest

from firmware_py import messages, results
from palpate.sim.probe import source
from palpate.sim.probe.virtual import VirtualBoard
from tests.benchmarks.bench_link import Still
from tests.firmware_py.streaming import AIR, SECOND, STROKE, of, start
from tests.firmware_py.talk import Bench, command

FRAMES, STROKES = messages.CONTENT_FRAMES, messages.CONTENT_STROKES


def slow(tmp_path, bytes_per_s):
    return Bench.measuring(tmp_path, STROKE, bytes_per_s=bytes_per_s, link_bytes=4096)


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
    assert [m.name for m in late[:23]] == ["estimate"] * 20 + ["map"] * 3
    assert [m.fields["stroke"] for m in late[:20]] == list(range(last - 19, last + 1))


def campaign(tmp_path, bytes_per_s, stopped_s, seconds=180):
    """A stroke every 2.4 s, over such a link, whose host reads nothing in the middle; what came of it."""
    stroke = AIR * 3 + source.records(Still(114)) + AIR * 3
    bench = Bench.measuring(tmp_path, stroke, bytes_per_s=bytes_per_s, link_bytes=4096)
    board = bench.probe.board
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


def test_a_slow_link_costs_the_oldest_frames_whole_and_counted():
    board = VirtualBoard(bytes_per_s=10_000, link_bytes=1000)
    bench = Bench(board)
    bench.ask("stream_start", (FRAMES, 1, 0, 0), us=2_000_000)
    bench.run(3_000_000)
    stop = bench.ask("stream_stop", us=3_000_000)
    numbers = [m.fields["seq"] for m in bench.heard if m.name == "frame"]
    assert numbers == sorted(set(numbers))
    missing = stop.fields["next_seq"] - len(numbers)
    assert missing > 50
    assert bench.probe.counter("frames_dropped") == missing
    assert bench.probe.counter("frames_sent") == len(numbers)
    assert bench.ears.receiver.bad_crc == bench.ears.receiver.bad_frame == 0
    assert max(np.diff(numbers)) < 20, "the newest frames are kept, so the gaps are even"


def test_a_host_that_never_reads_costs_no_memory_and_loses_no_answer():
    board = VirtualBoard(bytes_per_s=1, link_bytes=700)
    bench = Bench(board)
    bench.send(command("stream_start", 1, (FRAMES | STROKES, 1, 0, 0)))
    for number in range(2, 200):
        bench.probe.send(command("get_setting", number, (0,)))
        bench.run(50_000)
    assert len(bench.probe.board.to_probe) > 0, "commands wait in the link while answers find no room"
    board._bytes_per_s = 1_000_000
    bench.run(2_000_000)
    answers = [m.number for m in bench.heard if m.name == "get_setting"]
    assert answers == list(range(2, 200))
