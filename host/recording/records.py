"""The records of an MCAP file, damaged or not: what is whole is read, the rest is passed over and counted.

A record is an opcode, a length and a body. One is believed where another stands behind it, or where its own
content is closed (a packet's zero, a JSON object's braces); else the next place is sought where records
follow each other. The stretch between is told as damage, and a message whose head was hit is still read.
The work is linear in the size: where damage has no end, the rest is passed over.

Source of the layout: the MCAP specification, https://mcap.dev/spec.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Generator
from dataclasses import dataclass
from io import BytesIO
from typing import IO, Any

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

HEAD = struct.Struct("<BQ")
LONGEST = 1 << 28
"""Longest record, bytes; nothing longer is written."""

_LONGEST_REPAIRED = 1 << 22
_MESSAGE = struct.Struct("<HIQQ")
_CRC = struct.Struct("<I")
_BLOCK = 1 << 18
_SOUGHT = 1 << 12
_PLACES = 4096  # of damage, and one for each so many bytes besides
_BYTES_A_PLACE = 512
_WASTE = 1 << 20  # bytes read in vain, and twice the size besides
_LIKE_A_HEAD = re.compile(rb"[\x01-\x0f].{3}[\x00-\x10]\x00{4}", re.DOTALL)
_KINDS: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.MESSAGE_INDEX: MessageIndex,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT: Attachment,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.DATA_END: DataEnd,
}

Closed = Callable[[Message], bool]
"""Whether a message's content shows by itself that it is whole."""


@dataclass
class Damage:
    """What could not be read: how many places, how many bytes, where the first is and why."""

    places: int = 0
    n_bytes: int = 0
    first_at: int = 0
    why: str = ""

    def add(self, at: int, n_bytes: int, why: str) -> None:
        """One more place, in bytes from the file's beginning."""
        if not self.places:
            self.first_at, self.why = at, why
        self.places += 1
        self.n_bytes += n_bytes


class _Bytes:
    """A stream's bytes by place, read block by block; what lies far off costs no block."""

    def __init__(self, stream: IO[bytes], size: int) -> None:
        self.size = size
        self._stream = stream
        self._at = 0
        self._block = b""

    def read(self, at: int, end: int) -> bytes:
        """The bytes from `at` to `end`, and the block from there on kept."""
        if not self._at <= at <= end <= self._at + len(self._block):
            self._stream.seek(at)
            self._at, self._block = at, self._stream.read(min(max(_BLOCK, end - at), self.size - at))
        return self._block[at - self._at : end - self._at]

    def length(self, at: int) -> int | None:
        """Length of the body of the record that begins at `at`, None where none can begin."""
        place = at - self._at
        if 0 <= place <= len(self._block) - HEAD.size:
            opcode, length = HEAD.unpack_from(self._block, place)
        else:
            self._stream.seek(at)
            head = self._stream.read(HEAD.size)
            if len(head) < HEAD.size:
                return None
            opcode, length = HEAD.unpack(head)
        return length if 1 <= opcode <= Opcode.DATA_END and length <= LONGEST else None


def scan(
    stream: IO[bytes], at: int, size: int, closed: Closed, damage: Damage
) -> Generator[tuple[int, int, McapRecord]]:
    """The records of `stream` from `at` to `size`: (where it begins, where it ends, the record).

    What is incomplete at the end is left out, and is no damage.
    """
    source = _Bytes(stream, size)
    waste = _WASTE + 2 * (size - at)
    places = _PLACES + (size - at) // _BYTES_A_PLACE
    while size - at >= HEAD.size:
        length = source.length(at)
        if length is not None and (end := at + HEAD.size + length) <= size:
            opcode, body = _read(source, at, end)
            record = parse(opcode, body)
            if record is not None and (
                size - end < HEAD.size
                or source.length(end) is not None
                or (isinstance(record, Message) and closed(record))
            ):
                yield at, end, record
                at = end
                continue
            waste -= end - at
        places -= 1
        if places < 0 or waste < 0:
            damage.add(at, size - at, "too much is damaged")
            return
        found = _next_record(source, at + 1)
        if found == size and length is not None and at + HEAD.size + length > size:
            return  # the end was cut off
        damage.add(at, found - at, "a record is damaged")
        if found - at <= _LONGEST_REPAIRED:
            repaired = parse(Opcode.MESSAGE, _read(source, at, found)[1])
            if isinstance(repaired, Message) and closed(repaired):
                yield at, found, repaired
        at = found


def parse(opcode: int, body: bytes) -> McapRecord | None:
    """The record of a body; None where it cannot be one."""
    if opcode == Opcode.MESSAGE:
        if len(body) < _MESSAGE.size:
            return None
        channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(body)
        return Message(channel, log_time, body[_MESSAGE.size :], publish_time, sequence)
    kind = _KINDS.get(opcode)
    if kind is None:
        return None
    if opcode == Opcode.ATTACHMENT and not _attachment_is_sound(body):
        return None
    stream = ReadDataStream(BytesIO(body))
    try:
        record: McapRecord = kind.read(stream)
    except (McapError, EOFError, struct.error, ValueError, OverflowError, MemoryError):
        return None
    return record if stream.count == len(body) else None


def _attachment_is_sound(body: bytes) -> bool:
    """Whether its checksum is right, or 0: none."""
    if len(body) < _CRC.size:
        return False
    (crc,) = _CRC.unpack(body[-_CRC.size :])
    return crc in (0, zlib.crc32(body[: -_CRC.size]))


def _read(source: _Bytes, at: int, end: int) -> tuple[int, bytes]:
    raw = source.read(at, end)
    return raw[0], raw[HEAD.size :]


def _next_record(source: _Bytes, at: int) -> int:
    """Where the next record begins that fits and is followed by another, or by the end; else the size."""
    size = source.size
    while size - at >= HEAD.size:
        block = source.read(at, min(at + _SOUGHT, size))
        place = 0
        while (found := _LIKE_A_HEAD.search(block, place)) is not None:
            place = found.start() + 1
            end = at + found.start() + HEAD.size + HEAD.unpack(found[0])[1]
            if end == size or (end < size and source.length(end) is not None):
                return at + found.start()
        at += max(1, len(block) - HEAD.size + 1)
    return size
