"""Bytes into events, with every number accounted for, whatever the cut and whatever the damage."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py import calib, geometry, messages, wire
from palpate.sim.probe.faults import Faults, FaultyLine
from palpate.wire.events import Estimate, Frame, StrokeState
from palpate.wire.parser import LiveParser
from tests.campaigns import counted
from tests.host.link import wires


def parse(data: bytes, cuts=(), parser=None):
    parser = parser or LiveParser()
    events, raws, before = [], [], 0
    for cut in [*sorted(c for c in cuts if c < len(data)), len(data)]:
        for event in parser.feed(data[before:cut], 1_000):
            events.append(event)
            raws.append(parser.raw)
        before = cut
    return parser, events, raws


@given(st.lists(st.integers(0, 4000), max_size=20))
def test_no_cut_of_the_stream_matters_and_no_byte_is_forgotten(cuts):
    data = wires.identified() + b"".join(wires.frame(k) for k in range(4)) + wires.estimate(1) + b"\x05half"
    parser, events, raws = parse(data, cuts)
    assert b"".join(raws) + parser.take_tail() == data
    assert parser.counts.bytes_received == len(data)
    assert [e.seq for e in events if isinstance(e, Frame)] == [0, 1, 2, 3]
    assert [e.stroke for e in events if isinstance(e, Estimate)] == [1]


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0005, 0.003, 0.02]))
def test_a_damaged_wire_gives_no_wrong_frame_and_exact_losses(seed, much):
    sent = {k: wires.frame(k) for k in range(30)}
    line = FaultyLine(Faults(flip=much, lose=much, double=much, swap=much, chatter=much / 9), seed)
    start = wires.packet("stream_start", wires.start(0), answer=True)
    end = wires.packet("stream_stop", wires.stop(30), answer=True)
    data = start + b"".join(line.pass_through(packet) for packet in sent.values()) + b"\0" + end
    parser, events, _ = parse(data)
    parser.settle()
    frames = [e for e in events if isinstance(e, Frame)]
    assert all(set(f.packed) == {f.seq % 251 + 1} and f.position_um == 1000 * f.seq - 25000 for f in frames)
    counts = parser.frames.counts
    assert counts.received == len(frames) == len({f.seq for f in frames})
    assert counts.received + counts.lost == 30
    assert sum(f.lost_before for f in frames) <= counts.lost


def test_lost_frames_are_counted_at_both_ends_of_a_stream():
    parts = [wires.packet("stream_start", wires.start(10), answer=True)]
    parts += [wires.frame(k) for k in range(12, 20)]  # 10 and 11 never come
    parts += [wires.packet("stream_stop", wires.stop(23), answer=True)]  # nor do 20, 21, 22
    parser, _, _ = parse(b"".join(parts))
    assert parser.frames.counts.lost == 2
    parser.settle()
    assert parser.frames.counts.lost == 5
    parse(wires.packet("stream_start", wires.start(90), answer=True) + wires.frame(90), parser=parser)
    assert parser.frames.counts.lost == 5  # what passed between two streams was never promised


def test_a_result_that_comes_again_behind_many_newer_ones_is_not_repeated():
    """Behind 96 others it was handed out as another stroke's."""
    strokes = list(range(1, 201))
    parser, events, _ = parse(wires.started() + b"".join(map(wires.estimate, [*strokes, 1])))
    assert [e.stroke for e in events if isinstance(e, Estimate)] == strokes
    assert (parser.counts.resent, parser.strokes.received, parser.strokes.lost) == (1, len(strokes), 0)


@pytest.mark.parametrize("piece", [100, 65_536, 1 << 23])
def test_noise_is_handed_out_and_not_gathered(piece):
    """Noise without a packet grew the parser byte by byte: 277 MB for 270."""
    noise = np.random.default_rng(3).integers(1, 256, (8 << 20) + 30_000, dtype=np.uint8).tobytes()
    data, parser, got = noise + b"\0" + wires.frame(5), LiveParser(), bytearray()
    frames = []
    tracemalloc.start()
    for at in range(0, len(data), piece):
        for event in parser.feed(data[at : at + piece], 1):
            got += parser.raw
            frames += [event] if isinstance(event, Frame) else []
            assert len(parser.raw) < 9000
            if len(got) > len(noise) // 2 and tracemalloc.is_tracing():
                held = tracemalloc.get_traced_memory()[0] - len(got)
                tracemalloc.stop()
                assert held < 3 * piece + 1_500_000
    assert bytes(got) + parser.take_tail() == data
    assert [f.seq for f in frames] == [5] and parser.counts.oversize == 1


def test_messages_that_are_not_known_are_not_gathered_either():
    body = bytearray(200)
    body[0] = 0x7E
    target = bytearray(300)
    unknown = bytes(target[: wire.seal(body, 150, target, 0)])
    parser, events, raws = parse(1000 * unknown + wires.frame(1))
    assert parser.counts.unknown == 1000
    assert max(map(len, raws)) < 9000 and b"".join(raws).endswith(wires.frame(1))
    assert [e.seq for e in events if isinstance(e, Frame)] == [1]


def test_a_restart_of_the_probe_begins_all_counts_anew():
    before = wires.identified(1) + wires.frame(5000) + wires.estimate(1)
    parser, events, _ = parse(before + wires.identified(2) + wires.frame(0) + wires.estimate(1))
    assert [e.seq for e in events if isinstance(e, Frame)] == [5000, 0]
    assert len([e for e in events if isinstance(e, Estimate)]) == 2
    assert parser.frames.counts.restarts == 1 and parser.frames.counts.lost == 0


def test_a_restarted_probes_clock_begins_anew():
    late = wires.identified(1) + wires.frame(5, time_us=900_000_000)
    _, events, _ = parse(late + wires.identified(2) + wires.frame(0, time_us=10))
    assert [e.time_us for e in events if isinstance(e, Frame)] == [900_000_000, 10]


def test_states_that_never_came_are_counted_and_those_that_come_late_are_not_passed_on():
    states = [
        wires.packet("stroke_state", (number % (1 << 16), wires.STREAM, 1, 2, 0, 0, 0))
        for number in (65_534, 65_535, 2, 1, 3)
    ]
    parser, events, _ = parse(wires.started() + b"".join(states))
    assert [e.event_seq for e in events if isinstance(e, StrokeState)] == [65_534, 65_535, 2, 3]
    assert parser.counts.states_lost == 2


def test_every_so_many_frames_is_one_at_least():
    """A command that asks for every 0th frame ended the wire with a division by zero."""
    parser = LiveParser()
    parser.commanded(wires.packet("stream_start", (messages.CONTENT_STROKES, 0, 0, 10_000)))
    end = wires.packet("stream_stop", wires.stop(5), answer=True)
    _, events, _ = parse(wires.started() + wires.frame(0) + wires.frame(2) + end, parser=parser)
    parser.settle()
    assert [e.lost_before for e in events if isinstance(e, Frame)] == [0, 1]
    assert parser.frames.counts.lost == 3


def test_a_frame_of_another_size_is_no_frame():
    short = wires.packet("frame", (0, 0, 0, 0), bytes(geometry.FRAME_BYTES - 3))
    parser, events, _ = parse(wires.started() + short + wires.frame(1))
    assert [e.seq for e in events if isinstance(e, Frame)] == [1] and parser.counts.unreadable == 1


def test_of_a_calibration_that_changes_while_it_is_read_no_mixture_is_made():
    blob = calib.Calibration().to_bytes()
    half = len(blob) // 2
    pieces = [
        wires.packet(
            "read_back", (messages.READ_CALIBRATION, at, len(blob)), blob[at : at + half], answer=True
        )
        for at in range(0, len(blob), half)
    ]
    changed = wires.packet("calibrate", (0, 1, 0, 0), answer=True)
    parser, _, _ = parse(pieces[0] + changed + b"".join(pieces[1:]))
    assert not parser.scale.calibrated
    parse(b"".join(pieces), parser=parser)
    assert parser.scale.calibrated


def test_an_hour_at_a_thousandth_lost_is_counted_exactly_and_memory_stays_flat():
    """Half a minute here, the hour below: the real firmware on a virtual clock, the wire between."""
    from tests.host.link.simulated import stream_over_a_bad_line

    told = stream_over_a_bad_line(minutes=0.5, seed=8)
    assert told.received + told.lost == told.acquired
    assert told.lost == told.missing > 0
    assert told.grown_bytes < 200_000


@pytest.mark.long
def test_an_hour_of_streaming():
    from tests.host.link.simulated import stream_over_a_bad_line

    told = stream_over_a_bad_line(minutes=60, seed=9)
    counted(
        f"{told.acquired} frames acquired, {told.received} received, {told.lost} counted lost, "
        f"{told.missing} missing"
    )
    assert told.received + told.lost == told.acquired
    assert told.lost == told.missing > 0
    assert told.grown_bytes < 200_000


def test_echoes_and_unknown_messages_are_not_believed():
    from palpate.link.commands import pack_command

    parser, events, _ = parse(pack_command("identify", 3, (9,)) + wires.packet("boot", (1, 0))[:-3] + b"\0")
    assert events == []
    assert parser.counts.bad_crc + parser.counts.bad_frame == 1
    assert messages.SCHEMA  # the table both ends share


def test_a_slow_program_loses_the_oldest_frames_and_no_results():
    from palpate.link.event_queue import EventQueue

    data = b"".join(wires.frame(k) for k in range(50)) + wires.estimate(1) + wires.frame(50)
    queue = EventQueue(frames_kept=8)
    for event in parse(data)[1]:
        queue.put(event)
    got = []
    while (event := queue.get(0)) is not None:
        got.append(event)
    assert [e.seq for e in got if isinstance(e, Frame)] == list(range(43, 51))
    assert len([e for e in got if isinstance(e, Estimate)]) == 1
    assert queue.dropped == 43


def test_the_hosts_clock_of_a_session_takes_no_steps(monkeypatch):
    """A step forward by nine minutes shifted all later device times by turns of 17.9 minutes, in silence."""
    from palpate.link import host_clock

    clock = host_clock.HostClock()
    before, true = clock.now_ns(), host_clock.time.time_ns()
    assert abs(before - true) < 1_000_000_000
    for step_s in (600, -86400 * 365, 86400 * 365 * 80):
        monkeypatch.setattr(host_clock.time, "time_ns", lambda step_s=step_s: true + step_s * 1_000_000_000)
        assert 0 <= clock.now_ns() - before < 60_000_000_000
