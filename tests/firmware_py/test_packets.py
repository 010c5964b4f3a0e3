"""The packet layer: what is damaged is refused, what follows is received, at either end's parser."""

import binascii
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py import cobs, crc, messages, wire
from palpate.sim.probe.faults import Faults, FaultyLine
from tests.campaigns import counted
from tests.firmware_py.talk import ByteReceiver, receive

BODIES = st.binary(min_size=1, max_size=300)


def on_the_wire(body: bytes) -> bytes:
    target = bytearray(wire.wire_size(len(body)))
    end = wire.seal(bytearray(body + bytes(crc.SIZE)), len(body), target, 0)
    return bytes(target[:end])


PARSERS = (wire.Receiver, ByteReceiver)


def test_the_checksum_is_the_one_of_zlib():
    assert binascii.crc32(b"123456789") == 0xCBF43926
    buffer = bytearray(b"123456789" + bytes(4))
    assert crc.append_plain(buffer, 9) == 13
    assert buffer[9:] == bytes.fromhex("2639f4cb")


@given(BODIES)
def test_both_builds_of_the_checksum_agree(body):
    plain, fast = bytearray(body + bytes(4)), bytearray(body + bytes(4))
    n = len(body)
    assert crc.append_plain(plain, n) == crc.append(fast, n) == n + 4
    assert plain == fast
    assert crc.check_plain(plain, n + 4)
    assert crc.check(plain, n + 4)
    plain[n // 2] ^= 1
    assert not crc.check_plain(plain, n + 4)
    assert not crc.check(plain, n + 4)


def test_a_checksum_of_which_one_half_fits_is_none():
    body = b"a message"
    good = bytearray(body + bytes(4))
    crc.append_plain(good, len(body))
    left_by = {_register(bytes((a, b, 0, 0))): (a, b) for a in range(256) for b in range(256)}
    for half in (0x0000_0001, 0x0001_0000):  # what the register is off by when both bodies have been read
        c, d = next(
            (c, d) for c in range(256) for d in range(256) if half ^ _register(bytes((0, 0, c, d))) in left_by
        )
        wrong = (*left_by[half ^ _register(bytes((0, 0, c, d)))], c, d)
        bad = good[: len(body)] + bytes(x ^ y for x, y in zip(good[len(body) :], wrong))
        assert not crc.check_plain(bad, len(bad)) and not crc.check(bad, len(bad))


@pytest.mark.parametrize("parser", PARSERS)
def test_a_checksum_of_nothing_is_no_packet(parser):
    receiver = parser(20)
    assert receive(receiver, on_the_wire(b"") + on_the_wire(b"next")) == [b"next"]
    assert (receiver.packets, receiver.bad_crc) == (1, 1)


@pytest.mark.parametrize("parser", PARSERS)
def test_the_longest_body_is_as_long_as_was_said_and_a_longer_one_is_counted(parser):
    receiver = parser(20)
    longest, longer = on_the_wire(bytes(range(1, 21))), on_the_wire(bytes(range(1, 22)))
    assert receive(receiver, longer + longest) == [bytes(range(1, 21))]
    assert (receiver.packets, receiver.oversize) == (1, 1)


@pytest.mark.parametrize("parser", PARSERS)
def test_after_a_reconnect_what_was_half_there_is_forgotten(parser):
    receiver = parser(20)
    for half in (b"half", b"too long to be any packet of this receiver"):
        assert receive(receiver, half) == []
        receiver.reset()
        assert receive(receiver, on_the_wire(b"whole")) == [b"whole"]
    assert receiver.oversize == receiver.bad_crc == receiver.bad_frame == 0


def _register(data):
    """CRC-32's register after these bytes, begun with 0: linear in them."""
    return binascii.crc32(data, 0xFFFF_FFFF) ^ 0xFFFF_FFFF


@given(st.binary(max_size=800))
def test_stuffing_leaves_no_zero_and_comes_back(body):
    target = bytearray(cobs.worst_case(len(body)))
    end = cobs.encode(body, len(body), target, 0)
    assert end <= len(target)
    assert target.index(0) == end - 1
    for decode in (cobs.decode_plain, cobs.decode_blocks):
        copy = bytearray(target)
        assert decode(copy, end - 1) == len(body)
        assert copy[: len(body)] == body


@given(st.binary(max_size=300))
def test_both_decoders_agree_on_any_bytes(data):
    plain, blocks = bytearray(data), bytearray(data)
    n = cobs.decode_plain(plain, len(data))
    assert cobs.decode_blocks(blocks, len(data)) == n
    if n >= 0:
        assert plain[:n] == blocks[:n]


@given(st.lists(BODIES, max_size=6), st.lists(st.integers(1, 50), min_size=1, max_size=20))
def test_any_way_of_cutting_the_stream_gives_the_same_packets(bodies, cuts):
    stream = b"".join(on_the_wire(b) for b in bodies)
    for parser in PARSERS:
        receiver = parser(300)
        got, at, k = [], 0, 0
        while at < len(stream):
            piece = stream[at : at + cuts[k % len(cuts)]]
            got += receive(receiver, piece)
            at += len(piece)
            k += 1
        assert got == bodies


@given(st.binary(max_size=2000))
def test_noise_is_survived_and_both_parsers_agree_on_it(noise):
    outcomes = []
    for parser in PARSERS:
        receiver = parser(100)
        got = receive(receiver, noise + b"\0")
        counts = (receiver.packets, receiver.bad_crc, receiver.bad_frame, receiver.oversize)
        assert receiver.packets == len(got)
        assert len(receiver.packet) == len(parser(100).packet)
        assert receive(receiver, on_the_wire(b"still here")) == [b"still here"]
        outcomes.append((got, counts))
    assert outcomes[0] == outcomes[1]


@settings(max_examples=200)
@given(st.data())
def test_damage_costs_at_most_the_packet_behind_it(data):
    """Whatever happens to one packet, the second one behind it arrives, and everything after."""
    bodies = [bytes([i]) * 40 for i in range(1, 6)]
    packets = [bytearray(on_the_wire(b)) for b in bodies]
    line = FaultyLine(
        Faults(flip=0.05, lose=0.05, double=0.05, swap=0.05, burst=0.05), data.draw(st.integers(0, 2**32))
    )
    stream = line.pass_through(bytes(packets[0])) + b"".join(packets[1:])
    for parser in PARSERS:
        assert receive(parser(300), stream)[-3:] == bodies[2:]


def damaged(packets: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Every row changed somewhere: flipped bits, a burst, lost, doubled or exchanged bytes (same length)."""
    n, length = packets.shape
    out = packets.copy()
    rows = np.arange(n)
    kind = random.integers(0, 5, n)
    at, other = random.integers(0, length, n), random.integers(0, length, n)
    for _ in range(3):
        some = kind == 0
        where = random.integers(0, length, n)
        out[rows[some], where[some]] ^= np.uint8(1) << random.integers(0, 8, int(some.sum())).astype(np.uint8)
    for k in range(8):
        some = kind == 1
        where = np.minimum(at + k, length - 1)
        out[rows[some], where[some]] = random.integers(0, 256, int(some.sum()))
    column = np.arange(length)
    lost = np.where(column >= at[:, None], np.minimum(column + 1, length - 1), column)
    doubled = np.where(column > at[:, None], column - 1, column)
    for k, source in ((2, lost), (3, doubled)):
        some = kind == k
        out[some] = np.take_along_axis(packets, source, axis=1)[some]
    some = kind == 4
    out[rows[some], at[some]] = packets[rows[some], other[some]]
    out[rows[some], other[some]] = packets[rows[some], at[some]]
    unchanged = (out == packets).all(axis=1)
    out[unchanged, 0] ^= 0x55
    return out


def test_a_million_damaged_packets_and_none_is_accepted():
    """Damaged between two zeros, so that each stands alone; sizes from a stroke state to a frame."""
    random = np.random.default_rng(6)
    tried = accepted = 0
    for body_length, n in ((12, 500_000), (28, 300_000), (50, 180_000), (messages.FRAME_BODY, 20_000)):
        bodies = random.integers(1, 256, (256, body_length), dtype=np.uint8)
        bodies[random.random(bodies.shape) < 0.05] = 0
        wires = [on_the_wire(b.tobytes())[:-1] for b in bodies]
        length = max(map(len, wires))
        wires = [w for w in wires if len(w) == length]
        packets = np.frombuffer(b"".join(wires), np.uint8).reshape(-1, length)
        receiver = wire.Receiver(messages.FRAME_BODY)
        for start in range(0, n, 20_000):
            block = packets[random.integers(0, len(packets), min(20_000, n - start))]
            bad = damaged(block, random)
            stream = np.zeros((len(bad), length + 1), np.uint8)
            stream[:, :length] = bad
            accepted += len(receive(receiver, stream.tobytes()))
            tried += len(bad)
    counted(f"{tried} damaged packets, {accepted} accepted")
    assert tried == 1_000_000
    assert accepted == 0


def test_the_parser_needs_no_memory():
    """What other threads of a test's process keep was once counted as its own."""
    receiver = ByteReceiver(messages.FRAME_BODY)
    stream = on_the_wire(bytes(range(256)) * 2)

    def feed(times):
        for _ in range(times):
            at = 0
            while at < len(stream):
                at = receiver.feed(stream, at, len(stream))

    own = tracemalloc.Filter(True, "*/firmware_py/*")

    def kept():
        traces = tracemalloc.take_snapshot().filter_traces([own]).statistics("filename")
        return sum(file.size for file in traces)

    tracemalloc.start()
    feed(20)  # what CPython keeps of a loop that it has come to know is not the parser's
    before = kept()
    feed(20)
    grown = kept() - before
    tracemalloc.stop()
    assert grown < 1000


def test_an_endless_packet_is_counted_once_and_forgotten():
    for parser in PARSERS:
        receiver = parser(messages.COMMAND_BODY)
        assert receive(receiver, b"\x05" * 100_000 + b"\0") == []
        assert receiver.oversize == 1
        assert len(receiver.packet) < 100
        assert receive(receiver, on_the_wire(b"next")) == [b"next"]


@pytest.mark.long
@pytest.mark.parametrize("parser", PARSERS)
def test_ten_million_inputs_neither_crash_nor_hang(parser):
    """Random streams with the bytes that matter (zeros, length codes) overrepresented."""
    random = np.random.default_rng(60)
    receiver = parser(messages.COMMAND_BODY)
    inputs = 0
    while inputs < 10_000_000:
        noise = random.integers(0, 256, 1 << 20, dtype=np.uint8)
        noise[random.random(noise.shape) < 0.1] = 0
        noise[random.random(noise.shape) < 0.1] = 3
        receive(receiver, noise.tobytes())
        inputs = receiver.bad_crc + receiver.bad_frame + receiver.oversize + receiver.packets
    bad = f"{receiver.bad_crc} bad checksums, {receiver.bad_frame} not stuffed, {receiver.oversize} too long"
    counted(f"{inputs} inputs: {bad}, {receiver.packets} accepted")
    assert receiver.packets <= 1  # a chance of 2**-32 each
    assert len(receiver.packet) == len(parser(messages.COMMAND_BODY).packet)
