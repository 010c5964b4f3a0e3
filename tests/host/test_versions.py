"""A probe of another version is named exactly, and what to do is said, whatever it is met on."""

import os
import pty
import re
import threading
import tty

import pytest

from firmware_py import messages, tables
from host.errors import VersionMismatch
from host.link.events import Event
from host.link.identity import Identity
from host.link.parser import LiveParser
from host.link.probe import Probe
from host.link.transport import open_transport
from host.record.writer import RecordingWriter
from tests.host import wires

HERE = f"{tables.SCHEMA:08x}"
OWN = ".".join(map(str, tables.FIRMWARE))


def told(
    protocol=tables.PROTOCOL,
    schema=tables.SCHEMA,
    firmware=tables.FIRMWARE,
    columns=messages.COLUMNS,
    nonce=7,
) -> tuple:
    """The fields of an identify answer."""
    who = (nonce, protocol, schema, firmware, b"OTHER-ON", messages.ROWS, columns, 1500, 12, 0)
    return (*who, 1, -7, bytes(8), 1, 0)


OTHERS = {
    "older firmware": (
        told(schema=0xAAAA, firmware=b"\0\0\7"),
        ("schema", "firmware"),
        f"schema 0000aaaa (here {HERE}), firmware 0.0.7 (here {OWN}); install this program's firmware",
    ),
    "newer firmware": (
        told(schema=0xBBBB, firmware=b"\1\0\0"),
        ("schema", "firmware"),
        f"schema 0000bbbb (here {HERE}), firmware 1.0.0 (here {OWN}); the probe is the newer one: update",
    ),
    "newer protocol": (
        told(protocol=2, schema=0xCCCC),
        ("protocol version", "schema"),
        f"protocol version 2 (here 1), schema 0000cccc (here {HERE}), both firmware {OWN}; the probe is",
    ),
    "changed tables": (
        told(schema=0xDDDD),
        ("schema",),
        f"schema 0000dddd (here {HERE}), both firmware {OWN}; install this program's firmware",
    ),
    "another face": (told(columns=24), ("cells",), "cells 16 x 24 (here 16 x 26), both firmware"),
}


@pytest.mark.parametrize("what", OTHERS)
def test_it_is_said_what_differs_and_what_to_do(what):
    values, names, words = OTHERS[what]
    with pytest.raises(VersionMismatch, match=re.escape(words)) as caught:
        Identity.from_answer(values).check()
    assert caught.value.names == names
    text = str(caught.value)
    assert ". " not in text and not text.endswith("."), "one sentence"


def test_another_firmware_of_the_same_tables_is_welcome():
    Identity.from_answer(told(firmware=b"\0\2\0")).check()


def test_a_recording_of_another_version_is_not_misread(tmp_path):
    path, parser = tmp_path / "old.mcap", LiveParser()
    with RecordingWriter(path) as writer:
        for event in parser.feed(wires.packet("identify", told(schema=1), answer=True), 1):
            assert isinstance(event, Event)
            writer.received(parser.raw, event, 1)
    with pytest.raises(VersionMismatch, match="schema 00000001"):
        Probe.open(str(path))


def test_a_live_probe_of_another_version_is_not_spoken_to():
    """It answers the handshake, under the id that it was asked with, and is asked nothing else."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    asked = []

    def answer():
        parser = LiveParser()
        while data := os.read(ours, 4096):
            for event in _commands(parser, data):
                asked.append(event)
                body = bytearray(wires.packet("identify", told(schema=0xEEEE), answer=True, number=event[1]))
                os.write(ours, body)
                return

    thread = threading.Thread(target=answer, daemon=True)
    thread.start()
    with pytest.raises(VersionMismatch, match="schema 0000eeee"):
        Probe(open_transport(os.ttyname(theirs)))
    thread.join(5)
    assert [name for name, _ in asked] == ["identify"]
    os.close(ours)
    os.close(theirs)


def _commands(parser, data):
    """Name and id of every whole command in the bytes."""
    from firmware_py import wire

    receiver = parser.__dict__.setdefault("ears", wire.Receiver(messages.COMMAND_BODY))
    at = 0
    while at < len(data):
        at = receiver.feed(data, at, len(data))
        if receiver.length:
            yield messages.TABLE[receiver.packet[0]][1], messages.message_id(receiver.packet)
