"""Rot in a recording: what is whole is read, the rest is said, nothing is replaced that was not read."""

import re
import struct

import numpy as np
import pytest

from palpate.errors import RecordingError
from palpate.recording import channels
from palpate.recording.playback import open_recording
from palpate.recording.reader import MAGIC, Recording
from palpate.recording.writer import RecordingWriter, seal_file
from palpate.wire.events import Estimate, Frame
from palpate.wire.parser import LiveParser
from tests.campaigns import counted
from tests.host.link import wires

FRAMES = 20
HEAD = struct.Struct("<BQ")
FORMS = {"killed": None, "plain": False, "sealed": True}


def session(path, seal, frames=FRAMES):
    """A recording of frames with an attachment and words; `seal` None: its writer was killed at the end."""
    parser, rng = LiveParser(), np.random.default_rng(1)
    writer = RecordingWriter(path)
    data = wires.identified() + wires.started() + b"".join(wires.frame(k, rng=rng) for k in range(frames))
    for k, event in enumerate(parser.feed(data + wires.estimate(1), 10**18)):
        writer.received(parser.raw, event, 10**18 + k)
    writer.attach(channels.MODEL, "application/octet-stream", rng.bytes(3000))
    writer.note("counts", {"frames_received": str(frames)})
    if seal is None:
        writer._journal.close()
        return path.read_bytes()
    writer.close(seal)
    return path.read_bytes()


def read(path):
    """(Frames and estimates as they were felt, whether anything is said to be amiss.)"""
    with open_recording(path) as played:
        events = [e for e in played.events() if isinstance(e, Frame | Estimate)]
        recording, counts = played.recording, played.counts
        said = recording.check() or counts.bad_crc or counts.bad_frame or counts.oversize
    felt = [(e.seq, e.packed, e.position_um) if isinstance(e, Frame) else e.numbers for e in events]
    return felt, said or not recording.finished


def flipped(data, bit):
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def records_of(data):
    """(Where it begins, opcode, length) of every record of a sound file."""
    at = len(MAGIC)
    while at + HEAD.size <= len(data) - len(MAGIC):
        opcode, length = HEAD.unpack_from(data, at)
        yield at, opcode, length
        at += HEAD.size + length


def campaign(tmp_path, form, step):
    """Every `step`th bit flipped: how many files, how many items at most and on average each has cost."""
    path = tmp_path / f"{form}.mcap"
    data = session(path, FORMS[form])
    whole, _ = read(path)
    assert len(whole) == FRAMES + 1
    lost = []
    for bit in range(0, 8 * len(data), step):
        path.write_bytes(flipped(data, bit))
        felt, said = read(path)
        assert [item for item in whole if item in felt] == felt, f"bit {bit}: something was made up"
        assert len(felt) == len(whole) or said, f"bit {bit}: {len(whole) - len(felt)} lost in silence"
        assert said or form == "killed", f"bit {bit}: a finished file was changed in silence"
        lost.append(len(whole) - len(felt))
        if bit % (8 * step) == 0 and form == "plain":
            before = path.read_bytes()
            with pytest.raises(RecordingError, match=r"left as it is|sealed|no end"):
                seal_file(path)
            assert path.read_bytes() == before
    return len(lost), max(lost), sum(lost) / len(lost)


@pytest.mark.parametrize("form", FORMS)
def test_a_flipped_bit_costs_little_and_is_said(tmp_path, form):
    _, most, _ = campaign(tmp_path, form, 9973)
    assert most <= (1 if form != "sealed" else FRAMES + 1)


@pytest.mark.long
@pytest.mark.parametrize("form", FORMS)
def test_rot_at_every_97th_bit(tmp_path, form):
    files, most, mean = campaign(tmp_path, form, 97)
    counted(f"{files} files, at most {most} of {FRAMES + 1} frames lost, {mean:.3f} on average")
    assert most <= (1 if form != "sealed" else FRAMES + 1)


@pytest.mark.parametrize("bit", [0, 3, 9, 17, 24, 33, 60])
def test_one_bit_in_a_length_costs_no_frame(tmp_path, bit):
    """It cost all that followed, and sealing then replaced the file by what was left: 32 of 82."""
    path = tmp_path / "length.mcap"
    data = session(path, False)
    places = [at for at, opcode, length in records_of(data) if opcode == 5 and 600 < length < 900]
    path.write_bytes(flipped(data, 8 * (places[10] + 1) + bit))
    felt, _ = read(path)
    assert len(felt) == FRAMES + 1
    assert re.search(rf"damaged: .* near byte {places[10]}; \d+ bytes", Recording(path).check())


def test_what_was_not_fully_read_is_never_replaced(tmp_path, monkeypatch):
    """Sealing put what it could read in the place of all that there was."""
    path = tmp_path / "seal.mcap"
    data = session(path, False)
    places = [at for at, opcode, _ in records_of(data) if opcode == 5]
    harmed = flipped(data, 8 * (places[40] + 2))
    path.write_bytes(harmed)
    with pytest.raises(RecordingError, match=r"damaged: .* it was left as it is"):
        seal_file(path)
    path.write_bytes(data[:-700])
    with pytest.raises(RecordingError, match="has no end"):
        seal_file(path)
    assert path.read_bytes() == data[:-700]
    path.unlink()
    writer = RecordingWriter(path)
    monkeypatch.setattr(writer._journal, "close", lambda: path.write_bytes(harmed))
    writer.close()
    assert path.read_bytes() == harmed
    with pytest.raises(RecordingError, match="left as it is"):
        writer.check()
    assert list(tmp_path.iterdir()) == [path]


def test_a_hole_costs_what_was_in_it(tmp_path):
    path = tmp_path / "hole.mcap"
    data = session(path, False)
    third = len(data) // 3
    path.write_bytes(data[:third] + np.random.default_rng(2).bytes(5000) + data[third + 5000 :])
    felt, said = read(path)
    assert FRAMES + 1 - 6 <= len(felt) < FRAMES + 1
    assert said
