"""A host that says anything at all: every packet is answered, and the stream goes on."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py import messages, status
from tests.firmware_py.talk import Bench, packet

FRAMES = messages.CONTENT_FRAMES
COMMAND_NAMES = [c[1] for c in messages.COMMANDS]


@pytest.mark.parametrize(
    ("body", "code"),
    [
        (bytes([0x3F, 1, 0]), status.BAD_TYPE),
        (bytes([0x01]), status.BAD_LENGTH),
        (bytes([0x01, 1, 0, 1]), status.BAD_LENGTH),
        (bytes([0x06, 1, 0, 9]), status.BAD_LENGTH),
        (bytes([0x40, 1, 0]) + bytes(30), status.BAD_TYPE),
        (bytes([0x81, 1, 0, 0]), status.BAD_TYPE),
        (bytes([0x05, 1, 0, 0, 1]) + bytes(6), status.BAD_VALUE),
        (bytes([0x0A, 1, 0, 0, 0, 1, 0]) + bytes(8), status.NOT_SUPPORTED),
        (bytes([0x0B, 1, 0, 0, 0, 0, 0, 1]), status.NOT_SUPPORTED),
    ],
)
def test_what_it_does_not_know_or_cannot_do_is_answered_with_a_code(body, code):
    bench = Bench()
    bench.run(1000)
    answers = bench.send(packet(body))
    assert [a.code for a in answers] == [code]
    assert bench.probe.counter("commands_refused") == 1


def streaming() -> Bench:
    bench = Bench()
    bench.ask("stream_start", (FRAMES, 1, 0, 0))
    return bench


def still_streams(bench: Bench) -> bool:
    return len([m for m in bench.run(100_000) if m.name == "frame"]) >= 4


@pytest.mark.parametrize(
    "attack",
    [
        b"\x03" * 50 + b"\x04" * 50,
        b"\x03\x04\r\nimport os; os.remove('main.py')\r\n\x04",
        b"\x01import machine\x04",
        b"A" * 100_000,
        b"\0" * 10_000,
        packet(b"\x01\x00\x00" + b"\xff" * 500),
        b"".join(packet(bytes([k]) * 40) for k in range(1, 255)),
    ],
)
def test_an_attack_does_not_stop_the_stream(attack):
    bench = streaming()
    bench.send(attack, us=1_000_000)
    assert still_streams(bench)
    assert bench.ask("identify", (1,)).code == status.OK


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.one_of(st.binary(max_size=80), st.binary(min_size=1, max_size=57).map(packet)), max_size=20)
)
def test_any_bytes_are_survived_and_every_packet_is_answered(pieces):
    bench = streaming()
    before = bench.ears.receiver.packets
    for piece in pieces:
        bench.send(piece, us=20_000)
    bench.send(b"\0", us=400_000)
    assert bench.ears.receiver.bad_crc == bench.ears.receiver.bad_frame == 0
    assert bench.ears.receiver.packets >= before
    accepted = bench.probe.firmware.receiver.packets
    answered = sum(bench.probe.counter(n) for n in ("commands", "commands_refused", "commands_duplicate"))
    assert accepted == answered
    assert bench.ask("identify", (1,), us=400_000).code == status.OK


@settings(max_examples=100, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(COMMAND_NAMES), st.binary(max_size=50), st.integers(0, 3)), max_size=30
    )
)
def test_any_order_of_commands_is_answered_one_by_one(commands):
    bench = Bench()
    bench.run(1000)
    for name, fields, number in commands:
        bench.probe.send(packet(bytes([messages.TYPE[name], number, 0]) + fields))
        answers = [m for m in bench.run(30_000) if m.kind & messages.ANSWER]
        assert len(answers) == 1
        assert answers[0].number == number
    assert bench.ask("identify", (1,), us=400_000).code == status.OK
