"""A probe of another version is named exactly, and what to do is said, whatever it is met on."""

import os
import pty
import re
import shutil
import threading
import tty

import pytest

from firmware_py import geometry, messages, tables
from palpate.errors import CommandRefused, VersionMismatch
from palpate.link.flash import flash
from palpate.link.probe import Probe
from palpate.link.transport import open_transport
from palpate.recording.playback import open_recording
from palpate.recording.writer import RecordingWriter
from palpate.sim.probe import emulated as emulator
from palpate.wire.events import Estimate, Event
from palpate.wire.identity import Identity
from palpate.wire.parser import LiveParser
from tests.host.link import wires
from tests.host.probes import connect
from tests.waiting import PATIENCE_S

HERE = f"{tables.PROTOCOL}"
OWN = ".".join(map(str, tables.FIRMWARE))


def told(
    protocol=tables.PROTOCOL,
    schema=tables.SCHEMA,
    firmware=tables.FIRMWARE,
    columns=geometry.COLUMNS,
    nonce=7,
) -> tuple:
    """The fields of an identify answer."""
    who = (nonce, protocol, schema, firmware, b"OTHER-ON", geometry.ROWS, columns, 1500, 12, 0)
    return (*who, 1, -7, bytes(8), 1, 0, 0, 0)


OTHERS = {
    "older firmware": (
        told(protocol=1, schema=0xAAAA, firmware=b"\0\0\7"),
        ("protocol version", "firmware"),
        f"protocol version 1 (here {HERE}), firmware 0.0.7 (here {OWN}); install this program's firmware",
    ),
    "newer firmware": (
        told(protocol=tables.PROTOCOL + 1, schema=0xBBBB, firmware=b"\1\0\0"),
        ("protocol version", "firmware"),
        f"(here {HERE}), firmware 1.0.0 (here {OWN}); the probe is the newer one: update",
    ),
    "newer protocol": (
        told(protocol=tables.PROTOCOL + 1),
        ("protocol version",),
        f"(here {HERE}), both firmware {OWN}; the probe is the newer one",
    ),
    "another array": (
        told(columns=24),
        ("array",),
        "array 16x24 at 1500 um (here 16x26 at 1500 um), both firmware",
    ),
}


@pytest.mark.parametrize("what", OTHERS)
def test_it_is_said_what_differs_and_what_to_do(what):
    values, names, words = OTHERS[what]
    with pytest.raises(VersionMismatch, match=re.escape(words)) as caught:
        Identity.from_answer(values).check()
    assert caught.value.names == names
    text = str(caught.value)
    assert ". " not in text and not text.endswith("."), "one sentence"


def test_another_firmware_of_the_same_protocol_is_welcome():
    """Any other schema used to be turned away, so that every addition was a break."""
    Identity.from_answer(told(firmware=b"\0\7\0", schema=0xDDDD)).check()


RESEND = '    (7, "resend_results", "ms", 50, 60000, 500),\n'
LEASES = '    "leases_expired",  # streams that ended because nobody renewed them\n'
OTHER_FIRMWARE = {
    "newer": (
        ("tables.py", "x00\\x02\\x00", "x00\\x07\\x00"),
        ("tables.py", '"IBI3s8sBBHBHBb8sIIBI"', '"IBI3s8sBBHBHBb8sIIBIH"'),
        ("tables.py", "damage stream", "damage stream news"),
        ("handlers.py", "damage(), probe.stream.number)", "damage(), probe.stream.number, 77)"),
        ("tables.py", "EVENTS = (", 'EVENTS = (\n    (0x5F, "news", "I", "number", "B"),'),
        ("probe.py", ".drop_frames()\n", ".drop_frames()\n        self._post(0x5F, (5,), b'!')\n"),
        ("tables.py", RESEND, RESEND + '    (8, "novelty", "ms", 1, 9, 5),\n'),
        ("tables.py", LEASES, LEASES + '    "novelties",\n'),
        ("tables.py", "COMMANDS = (", 'COMMANDS = (\n    (0x3E, "renew_all", "", "", ""),'),
    ),
    "older": (
        ("tables.py", "x00\\x02\\x00", "x00\\x01\\x07"),
        ("tables.py", '    (0x11, "results", "I", "stream", ""),\n', ""),
        ("handlers.py", '        (messages.TYPE["results"], mine.results),\n', ""),
        ("tables.py", RESEND, ""),
        ("probe.py", "settings.RESEND_RESULTS)", "settings.STROKE_PAUSE)"),
        ("tables.py", LEASES, ""),
    ),
}


@pytest.mark.parametrize("what", OTHER_FIRMWARE)
def test_a_probe_that_knows_more_or_less_is_spoken_to_all_the_same(
    what, emulated, images, tmp_path, monkeypatch
):
    """Real MicroPython with fields, messages, settings and counters that this program has not, or lacks."""
    folder = tmp_path / "firmware"
    shutil.copytree(emulator.FIRMWARE, folder)
    for name, old, new in OTHER_FIRMWARE[what]:
        text = (folder / name).read_text()
        assert text.count(old) == 1, (name, old)
        (folder / name).write_text(text.replace(old, new))
    monkeypatch.setattr(emulator, "FIRMWARE", folder)
    with connect(emulated("micropython")) as probe:
        assert probe.identity.firmware == {"newer": "0.7.0", "older": "0.1.7"}[what]
        assert flash(probe, images[0]).model_id == probe.identity.model_id
        events = list(probe.stream(strokes=1, timeout_s=PATIENCE_S))
        assert [e.valid for e in events if isinstance(e, Estimate)] == [True]
        assert set(probe.statistics()) <= set(messages.COUNTERS)
        assert probe.earlier_results() == []
        with pytest.raises(CommandRefused, match="outside its range"):
            probe.command("get_setting", 9)
        assert probe.counts.unreadable == 0
        assert probe.counts.unknown == (what == "newer"), "the event that we do not know"


def test_fields_that_an_older_probe_does_not_send_are_zero(monkeypatch):
    kind = messages.TYPE["identify"] | messages.ANSWER
    body = bytearray(200)
    length = messages.pack(body, kind, 5, 0, told())
    _, name, fields, names, tail = messages.TABLE[kind]
    monkeypatch.setitem(messages.TABLE, kind, (kind, name, fields + "H", names + " news", tail))
    monkeypatch.setitem(messages.FORMATS, kind, ("<" + fields + "H", tail))
    assert messages.unpack(body, length) is None, "a field of the first release is missing"
    monkeypatch.setitem(tables.ADDED, kind, 2)
    assert messages.unpack(body, length) == (*told(), 0)
    assert messages.unpack(body, length - 1) is None


def test_a_command_is_exactly_as_long_as_its_table_says():
    """Behind a command nothing may be added: a probe that passed it over would do something else."""
    body = bytearray(60)
    length = messages.pack(body, messages.TYPE["get_setting"], 5, 0, (1,))
    assert messages.unpack(body, length) == (1,)
    assert messages.unpack(body, length + 1) is None


def test_a_recording_of_another_version_is_not_misread(tmp_path):
    path, parser = tmp_path / "old.mcap", LiveParser()
    with RecordingWriter(path) as writer:
        for event in parser.feed(wires.packet("identify", told(protocol=1), answer=True), 1):
            assert isinstance(event, Event)
            writer.received(parser.raw, event, 1)
    with pytest.raises(VersionMismatch, match="protocol version 1"):
        open_recording(path)


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
                body = bytearray(wires.packet("identify", told(protocol=99), answer=True, number=event[1]))
                os.write(ours, body)
                return

    thread = threading.Thread(target=answer, daemon=True)
    thread.start()
    with pytest.raises(VersionMismatch, match="protocol version 99"):
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
