"""The page, the vectors and the schema hash say what messages.py says."""

import json
import struct

import pytest

from firmware_py import counters, messages, wire
from tests.firmware_py import c_header, protocol_files, protocol_session
from tests.firmware_py.protocol_words import FIELDS
from tests.firmware_py.talk import receive
from tests.micropython import run_micropython

HINT = "run: python -m tests.firmware_py.protocol_files"


def test_the_schema_hash_is_of_these_tables():
    assert protocol_files.schema() == messages.SCHEMA, HINT


def test_the_page_shows_these_tables():
    assert protocol_files.page() == protocol_files.PAGE.read_text(), HINT


def test_the_c_header_is_of_these_tables():
    assert protocol_files.HEADER.read_text() == c_header.header(), HINT


def test_every_field_has_its_meaning_once():
    fields = set()
    for _, name, _, names, tail in messages.COMMANDS + messages.ANSWERS + messages.EVENTS:
        fields |= {f"{name}.{word}" for word in [*names.split(), *(["tail"] if tail else [])]}
    assert fields == set(FIELDS)


MEANINGS = json.loads((protocol_files.VECTORS / "meaning.json").read_text())


@pytest.mark.parametrize("case", MEANINGS, ids=lambda case: case["what"].split(":")[0])
def test_a_message_means_what_its_vector_says(case):
    told = protocol_session.told(case["wire"])
    for name, wanted in case["means"].items():
        plain = isinstance(wanted, str) or name == "damaged"
        assert told[name] == (wanted if plain else pytest.approx(wanted)), name


def test_the_meanings_are_worked_out_anew():
    assert protocol_session.meanings() == MEANINGS, HINT


def rows():
    return [row for name in ("commands", "answers", "events") for row in json.loads(file(name).read_text())]


def file(name):
    return protocol_files.VECTORS / f"{name}.json"


def test_the_vector_files_are_of_these_tables():
    for name, wanted in protocol_files.vectors().items():
        assert file(name).read_text() == protocol_files.vector_text(wanted), HINT


@pytest.mark.parametrize("row", rows(), ids=lambda row: f"{row['type']:02x}-{row['name']}")
def test_a_vector_is_received_and_unpacked(row):
    body, stream = bytes.fromhex(row["body"]), bytes.fromhex(row["wire"])
    assert receive(wire.Receiver(messages.FRAME_BODY), stream) == [body]
    values = messages.unpack(body, len(body))
    if row["status"]:
        assert values == ()
        assert messages.answer_status(body) == row["status"]
        return
    tail = row["tail"]
    expected = [bytes.fromhex(v) if isinstance(v, str) else v for v in row["fields"].values()]
    if messages.TABLE[row["type"]][4]:
        expected.append(bytes.fromhex(tail) if isinstance(tail, str) else tuple(tail))
    assert list(values) == expected
    again = bytearray(700)
    length = messages.pack(again, row["type"], row["id"] or 0, row["status"] or 0, *split(row, values))
    assert again[:length] == body


def split(row, values):
    """Fields and tail, as `pack` wants them."""
    return (values[:-1], values[-1]) if messages.TABLE[row["type"]][4] else (values, b"")


def test_every_command_fits_into_64_bytes_on_the_wire():
    for kind, name, fields, _, tail in messages.COMMANDS:
        longest = messages.FLASH_PIECE if tail else 0
        length = messages.head_size(kind) + struct.calcsize("<" + fields) + longest
        assert wire.wire_size(length) <= messages.COMMAND_WIRE, name


def test_the_counters_are_named_in_their_order():
    for i, name in enumerate(messages.COUNTERS):
        assert getattr(counters, name.upper()) == i


def test_micropython_packs_and_receives_every_vector():
    """Real MicroPython's own parser and packer against the files."""
    lines = "\n".join(f"{row['body']} {row['wire']}" for row in rows())
    script = """
from binascii import unhexlify
from firmware_py import messages, wire
good = 0
for line in open("vectors"):
    body, stream = [unhexlify(x) for x in line.split()]
    receiver = wire.Receiver(messages.FRAME_BODY)
    assert receiver.feed(stream, 0, len(stream)) == len(stream)
    assert receiver.packet[:receiver.length] == body
    values = messages.unpack(body, len(body))
    tail = b""
    if body[0] & 128 == 0 or messages.answer_status(body) == 0:
        if messages.TABLE[body[0]][4]:
            values, tail = values[:-1], values[-1]
    number = messages.message_id(body) if messages.head_size(body[0]) > 1 else 0
    code = messages.answer_status(body) if body[0] & 128 else 0
    again = bytearray(700)
    n = messages.pack(again, body[0], number, code, values, tail)
    assert again[:n] == body, (again[:n], body)
    target = bytearray(wire.wire_size(n))
    end = wire.seal(again, n, target, 0)
    assert target[:end] == stream
    good += 1
print(good)
"""
    assert run_micropython(script, {"vectors": lines.encode()}).strip() == str(len(rows()))
