"""Recordings made to do harm: limits hold, checksums are compared, and the rest is read."""

import json
import subprocess
import sys
import zlib
from io import BytesIO

import numpy as np
import pytest
import zstandard
from click.testing import CliRunner
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer

from palpate.cli.convert import command as convert_command
from palpate.recording import channels, chunks, records
from palpate.recording.playback import open_recording
from palpate.recording.reader import Recording
from palpate.wire.events import Frame, Gap
from tests.host.link import wires
from tests.host.recording.test_damage import FRAMES, HEAD, read, records_of, session

BOMB = """
import resource, sys, zstandard
from palpate.recording.reader import Recording
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
said = Recording(sys.argv[1]).check()
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
print(said)
"""


def with_chunk(data, change):
    """A sealed file with its first chunk changed."""
    at, _, length = next(r for r in records_of(data) if r[1] == 6)
    chunk = records.parse(6, data[at + HEAD.size : at + HEAD.size + length])
    change(chunk)
    from mcap.data_stream import RecordBuilder

    built = RecordBuilder()
    chunk.write(built)
    return data[:at] + built.end() + data[at + HEAD.size + length :]


@pytest.mark.parametrize("told", [2 << 30, 1000])
def test_a_chunk_that_unpacks_to_two_gigabytes_takes_no_such_memory(tmp_path, told):
    """A chunk of 197 kB that declares 2 GiB took 2 GB."""
    path = tmp_path / "bomb.mcap"
    zeros = zstandard.ZstdCompressor().compressobj(size=2 << 30)
    block = bytes(1 << 24)
    bomb = b"".join(zeros.compress(block) for _ in range(128)) + zeros.flush()

    def swell(chunk):
        chunk.data, chunk.uncompressed_size = bomb, told

    path.write_bytes(with_chunk(session(path, True), swell))
    out = subprocess.run([sys.executable, "-c", BOMB, path], capture_output=True, text=True, check=True)
    grown_mb, said = out.stdout.splitlines()
    assert int(grown_mb) < 150
    assert "is damaged: a chunk" in said


def test_a_chunks_checksum_is_compared_and_its_packets_are_still_read(tmp_path):
    """1932 of 2634 messages were read past a wrong checksum, in silence."""
    path = tmp_path / "crc.mcap"

    def rot(chunk):
        raw = bytearray(chunks.unpack(chunk)[0])
        raw[len(raw) // 2] ^= 4
        chunk.data = zstandard.compress(bytes(raw))

    path.write_bytes(with_chunk(session(path, True), rot))
    felt, _ = read(path)
    assert FRAMES - 1 <= len(felt) <= FRAMES + 1
    assert "checksum does not match" in Recording(path).check()


def test_a_chunk_that_cannot_be_unpacked_is_a_sentence(tmp_path):
    """It was an uncaught ZstdError."""
    path = tmp_path / "zstd.mcap"

    def corrupt(chunk):
        chunk.data = b"\xff" * 40 + chunk.data[40:]

    path.write_bytes(with_chunk(session(path, True), corrupt))
    assert "cannot be unpacked" in Recording(path).check()
    done = CliRunner().invoke(convert_command, [str(path), str(tmp_path / "out.csv")])
    assert done.exit_code == 0 and "is damaged" in done.output


@pytest.mark.parametrize("packing", ["zstd", "lz4", "", "rar"])
def test_what_unpacks_within_limits_is_bounded(packing):
    raw = np.random.default_rng(1).bytes(5000)
    packed = {"zstd": zstandard.compress(raw), "lz4": raw, "": raw, "rar": raw}[packing]
    data, wrong = chunks.unpack(Chunk(packing, packed, 0, 0, zlib.crc32(raw), len(raw)))
    assert (data == raw and not wrong) if packing in ("zstd", "") else wrong


WRONG_JSON = [
    b"[]", b"null", b"3", b"{", b'"up"', b"{}", b'{"event":3}', b'{"event":"up"}',
    b'{"event":"up","seconds":"x","reason":"y","restarted":1}',
    b'{"event":"up","seconds":NaN,"reason":"y","restarted":1}',
    b'{"event":"up","seconds":' + b"9" * 400 + b',"reason":"y","restarted":1}',
    b'{"event":"up","seconds":' + b"9" * 9000 + b',"reason":"y","restarted":1}',
    b'{"event":' + b"[" * 100_000 + b"]" * 100_000 + b"}", b"\xff\xfe{}", b'{"message":[]}',
]  # fmt: skip


def test_json_of_the_wrong_shape_is_passed_over(tmp_path):
    """It was "unexpected KeyError", or RecursionError."""
    path = tmp_path / "json.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start("palpate", "made up")
        ids = {topic: writer.register_channel(topic, "json", 0) for topic in channels.TOPICS}
        writer.add_message(ids[channels.WIRE_IN], 1, wires.identified() + wires.frame(0), 1)
        for text in WRONG_JSON:
            for topic in (channels.LINK, channels.LOG, channels.ESTIMATE):
                writer.add_message(ids[topic], 2, text, 2)
        good = {"event": "up", "seconds": 2, "reason": "back", "restarted": True}
        writer.add_message(ids[channels.LINK], 3, json.dumps(good).encode(), 3)
        writer.add_message(ids[channels.WIRE_IN], 4, wires.frame(1), 4)
        writer.finish()
    with open_recording(path) as played:
        events = list(played.events())
    assert [e.seq for e in events if isinstance(e, Frame)] == [0, 1]
    assert [(e.seconds, e.reason, e.restarted) for e in events if isinstance(e, Gap)] == [(2.0, "back", True)]


def chunked(path, raw, size=None):
    """A recording that is one chunk of these bytes, and nothing besides."""
    from mcap.data_stream import RecordBuilder
    from mcap.records import Header

    built = RecordBuilder()
    Header("palpate", "made up").write(built)
    Chunk("zstd", zstandard.compress(raw, 19), 0, 0, 0, size or len(raw)).write(built)
    path.write_bytes(b"\x89MCAP0\r\n" + built.end())
    return path


HEADS = {
    "heads without a body": lambda at, size: 0,
    "bodies that reach to the last head": lambda at, size: max(0, size - at - 18),
    "bodies that reach to another head": lambda at, size: (size - at) // 18 * 9,
}


@pytest.mark.parametrize("kind", HEADS)
@pytest.mark.parametrize("opcode", [5, 9])  # message, attachment
def test_a_chunk_of_heads_is_read_in_linear_time(tmp_path, kind, opcode):
    """290 bytes of file, unpacked to a row of heads, took 30 s: all was read again behind each of them."""
    size = 1_800_000
    raw = b"".join(HEAD.pack(opcode, HEADS[kind](at, size)) for at in range(0, size, 9))
    inner = records.Damage()
    taken = Reads(raw)
    for _ in records.scan(taken, 0, size, lambda _message: False, inner):
        pass
    assert inner.places and inner.n_bytes <= size
    assert taken.n_bytes < 20 * size


class Reads(BytesIO):
    """A stream that counts what is read of it."""

    n_bytes = 0

    def read(self, n=-1):
        data = super().read(n)
        self.n_bytes += len(data)
        return data


def test_what_unpacks_to_over_a_thousand_times_its_size_is_a_sentence(tmp_path):
    path = chunked(tmp_path / "heads.mcap", HEAD.pack(5, 0) * 1_000_000)
    assert path.stat().st_size < 2000
    assert "a chunk unpacks to over 1000 times its size" in Recording(path).check()
