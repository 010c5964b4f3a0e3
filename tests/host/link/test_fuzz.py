"""The host's parser against hostile bytes: no exception, no growth, nothing believed that was not sent."""

import resource

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.wire.events import Estimate, Features, Frame, Log, StrokeState, TactileMap
from palpate.wire.parser import LiveParser
from tests.campaigns import counted
from tests.host.link import wires

BATCH = 2000


def corpus() -> list[bytes]:
    """A packet of every kind a probe sends."""
    return [
        wires.started(),
        wires.frame(3),
        wires.identified(),
        wires.estimate(1),
        wires.packet("stroke_state", (1, wires.STREAM, 1, 2, 5, 6, 7)),
        wires.packet("map", (wires.STREAM, 1, 0, 3, 9, 5, -2, 100, 6105, 1, 2, 3, 4), (1, 2, 3, 4, 5)),
        wires.packet("features", (wires.STREAM, 1, 0, 1), tuple(range(28))),
        wires.packet("stream_end", (wires.STREAM, 2, 100, 3, 9)),
        wires.packet("log", (1, 9), b"one line of text"),
        wires.packet("boot", (1, 0)),
        wires.packet("statistics", (), tuple(range(20)), answer=True),
        wires.packet("read_back", (0, 0, 9), b"ninebytes", answer=True),
    ]


def mutants(packets: list[bytes], n: int, rng: np.random.Generator) -> bytes:
    """So many packets of the corpus, each with some bytes changed, cut out, doubled or spliced in."""
    out = bytearray()
    for which, how, at, value in rng.integers(0, [len(packets), 5, 1 << 30, 256], (n, 4)):
        packet = bytearray(packets[which])
        k = int(at) % len(packet)
        if how == 0:
            packet[k] ^= int(value) | 1
        elif how == 1:
            del packet[k : k + 1 + int(value) % 9]
        elif how == 2:
            packet[k:k] = packet[k : k + 1 + int(value) % 9]
        elif how == 3:
            other = packets[int(value) % len(packets)]
            packet[k:] = other[k % len(other) :]
        else:
            packet[k:k] = rng.bytes(int(value) % 40)
        out += packet
    return bytes(out)


def bombard(batches: int, seed: int) -> tuple[int, int, int]:
    """Packets thrown at one parser, events that came of them, kB that the process has grown by."""
    rng, packets, parser = np.random.default_rng(seed), corpus(), LiveParser()
    true_frame = next(e for e in LiveParser().feed(packets[1], 0) if isinstance(e, Frame))
    seen, settled = 0, 0
    for batch in range(batches):
        for event in parser.feed(mutants(packets, BATCH, rng), batch):
            seen += 1
            if isinstance(event, Frame):  # only a whole packet of the corpus can have got through
                assert event.packed == true_frame.packed and event.seq == true_frame.seq
        parser.take_tail()
        if batch == batches // 3:
            settled = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - settled
    return batches * BATCH, seen, grown


def test_fifty_thousand_changed_packets():
    thrown, seen, grown_kB = bombard(25, 1)
    assert thrown == 50_000 and seen > 500  # a splice of a packet onto itself is whole
    assert grown_kB < 4000


@pytest.mark.long
def test_ten_million_changed_packets():
    thrown, seen, grown_kB = bombard(5000, 2)
    counted(f"{thrown} packets, {seen} of them still whole, memory grown by {grown_kB} kB")
    assert grown_kB < 4000


@settings(deadline=None, max_examples=300)
@given(st.lists(st.binary(max_size=80), max_size=12), st.integers(0, 2**60))
def test_any_bytes_in_any_cut(pieces, host_ns):
    parser = LiveParser()
    for piece in pieces:
        for event in parser.feed(piece, host_ns):
            assert not isinstance(event, Frame | Estimate | TactileMap | Features | Log | StrokeState)
    assert len(parser.take_tail()) <= sum(map(len, pieces))
