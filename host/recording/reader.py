"""Reading recordings, finished or not, damaged or not: whatever is whole is read, the rest is said."""

from __future__ import annotations

import zlib
from collections.abc import Generator
from io import BytesIO
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
)

from firmware_py import calib, status
from palpate.errors import NoSuchFile, NotARecording, RecordingError
from palpate.files import check_readable
from palpate.recording import channels, chunks, records

MAGIC = b"\x89MCAP0\r\n"
PROFILE = "palpate"
LARGEST = 1 << 40
"""Bytes: months of frames."""
_FOOTER_BYTES = 20
_BLOCK = 1 << 20


class Recording:
    """A recording on disk.

    Parameters
    ----------
    path : str or Path
        A .mcap file that `palpate stream --record` wrote, or was writing when it was killed.

    Attributes
    ----------
    finished : bool
        False where the file lacks its end: its writer was killed, or is still at it.

    Raises
    ------
    NoSuchFile, NotARecording
        It is not there, or something else.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        try:
            check_readable(self.path, LARGEST)
            with self.path.open("rb") as stream:
                known = _begins_like_one(stream)
                self._size = stream.seek(0, 2)
                stream.seek(max(len(MAGIC), self._size - len(MAGIC)))
                self.finished = stream.read() == MAGIC
        except FileNotFoundError:
            raise NoSuchFile(f"there is no recording {path}; check the name") from None
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise NoSuchFile(f"the recording {path} cannot be read: {reason}") from error
        if not known:
            raise NotARecording(
                f"{path} is not a recording (no MCAP file); `palpate stream --record` makes one"
            )
        self._found = records.Damage()
        self._attached: dict[str, bytes] | None = None

    @property
    def damage(self) -> str:
        """What could not be read so far, in one sentence; "" where all was."""
        found = self._found
        if not found.places:
            return ""
        what = f"{found.why} near byte {found.first_at}"
        if found.places > 1:
            what += f", and {found.places - 1} more"
        return f"{self.path} is damaged: {what}; {found.n_bytes} bytes were passed over, the rest was read"

    def records(self) -> Generator[tuple[str, McapRecord]]:
        """Every message, attachment and metadata record with its topic ("" where it has none), in order."""
        self._found = damage = records.Damage()
        with self.path.open("rb", buffering=0) as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                damage.add(0, len(MAGIC), "its first bytes are not MCAP's")
            topics = _Topics()
            end = self._size - (len(MAGIC) if self.finished else 0)
            crc = zlib.crc32(MAGIC)
            for at, until, record in records.scan(stream, len(MAGIC), end, topics.closed, damage):
                if isinstance(record, DataEnd):
                    if self.finished and self._summary_follows(stream, until):
                        if not damage.places and record.data_section_crc not in (0, crc):
                            damage.add(0, 0, "the checksum of the whole does not match, something changed")
                        return
                    continue
                if isinstance(record, Footer):
                    if self.finished:
                        damage.add(at, 0, "its end does not fit its beginning")
                    return
                if not damage.places:
                    crc = _crc(stream, at, until, crc)
                if isinstance(record, Chunk):
                    yield from self._unpacked(record, at, until, topics)
                elif (known := topics.take(record)) is not None:
                    yield known
                elif isinstance(record, Message):
                    damage.add(at, until - at, "a message is damaged")

    def _unpacked(
        self, chunk: Chunk, at: int, until: int, topics: _Topics
    ) -> Generator[tuple[str, McapRecord]]:
        """The records in a chunk; of a damaged one only packets, which have checksums of their own."""
        data, wrong = chunks.unpack(chunk)
        inner = records.Damage()
        for _, _, record in records.scan(BytesIO(data), 0, len(data), topics.closed, inner):
            if not wrong:
                known = topics.take(record)
                if known is not None:
                    yield known
            elif isinstance(record, Message) and topics.closed(record):
                topic, _ = topics.take(record) or ("", record)
                if topic in channels.WIRES:
                    first, last = chunk.message_start_time, chunk.message_end_time
                    record.log_time = min(max(record.log_time, first), max(first, last))
                    yield topic, record
        if wrong or inner.places:
            self._found.add(at, until - at, wrong or inner.why)

    def _summary_follows(self, stream: IO[bytes], at: int) -> bool:
        """Whether the data really ends at `at`; damage in the index behind it is told."""
        foot = self._size - len(MAGIC) - _FOOTER_BYTES - records.HEAD.size
        stream.seek(foot)
        raw = stream.read(records.HEAD.size + _FOOTER_BYTES)
        footer = records.parse(Opcode.FOOTER, raw[records.HEAD.size :])
        if not isinstance(footer, Footer):
            return False
        if raw[: records.HEAD.size] != records.HEAD.pack(Opcode.FOOTER, _FOOTER_BYTES):
            self._found.add(foot, 0, "its last record is damaged")
        if (footer.summary_start or foot) != at:
            return False
        if footer.summary_crc not in (0, _crc(stream, at, self._size - len(MAGIC) - 4, 0)):
            self._found.add(at, 0, "its index is damaged")
        return True

    def wire(self, topics: tuple[str, ...] = (channels.WIRE_IN,)) -> Generator[tuple[int, str, bytes]]:
        """The wire's bytes as they travelled: (host time in ns, topic, bytes); by default the probe's."""
        for topic, record in self.records():
            if topic in topics and isinstance(record, Message):
                yield record.log_time, topic, record.data

    def check(self) -> str:
        """Read it all once: where it is damaged, in words; "" where it is sound (a missing end is none)."""
        for _ in self.records():
            pass
        return self.damage

    def metadata(self) -> dict[str, dict[str, str]]:
        """Words about the session: session, probe, clock, counts (as far as written)."""
        return {r.name: r.metadata for _, r in self.records() if isinstance(r, Metadata)}

    def attachment(self, name: str) -> bytes | None:
        """An attached file, the last of that name: `model.palp`, `calibration.bin`."""
        if self._attached is None:
            attached = (record for _, record in self.records() if isinstance(record, Attachment))
            self._attached = {record.name: record.data for record in attached}
        return self._attached.get(name)

    def calibration(self) -> calib.Calibration:
        """The probe's own; where the recording holds none, the nominal one.

        Raises
        ------
        RecordingError
            It cannot be read.
        """
        own, blob = calib.Calibration(), self.attachment(channels.CALIBRATION)
        if blob and own.load(blob) != status.OK:
            raise RecordingError(f"the calibration in {self.path} cannot be read")
        return own


class _Topics:
    """Which channel carries which topic; those of our own files are known even where hit."""

    def __init__(self) -> None:
        self._of: dict[int, str] = {}
        self._ours = True

    def take(self, record: McapRecord) -> tuple[str, McapRecord] | None:
        """What a caller is given: (topic, record); None for the file's bookkeeping and what is damaged."""
        if isinstance(record, Header):
            self._ours = record.profile == PROFILE
        elif isinstance(record, Channel):
            self._of[record.id] = record.topic
        elif isinstance(record, Message):
            topic = self._topic(record.channel_id)
            if topic is not None and _could_be(topic, record.data):
                return topic, record
        elif isinstance(record, Attachment | Metadata):
            return "", record
        return None

    def closed(self, message: Message) -> bool:
        """Whether a message's content shows that it is whole."""
        topic = self._topic(message.channel_id)
        data = message.data
        if topic in channels.WIRES:
            return data.endswith(b"\0") and b"\0\0\0\0" not in data
        return (
            topic in channels.SCHEMAS and data.startswith(b"{") and data.endswith(b"}") and b"\0" not in data
        )

    def _topic(self, channel: int) -> str | None:
        told = self._of.get(channel)
        if self._ours and told not in channels.TOPICS:
            return channels.BY_ID.get(channel, told)
        return told


def _could_be(topic: str, data: bytes) -> bool:
    """False for JSON in a channel of packets, or the other way round: the channel's number was hit."""
    json = data.startswith(b"{") and data.endswith(b"}")
    return not json if topic in channels.WIRES else json or topic not in channels.SCHEMAS


def _begins_like_one(stream: IO[bytes]) -> bool:
    """Whether this is MCAP: by its first bytes or, where those were hit, by its first record."""
    head = stream.read(len(MAGIC) + records.HEAD.size)
    if head.startswith(MAGIC):
        return True
    if len(head) < len(MAGIC) + records.HEAD.size:
        return False
    opcode, length = records.HEAD.unpack(head[len(MAGIC) :])
    if opcode != Opcode.HEADER or length > _BLOCK:
        return False
    header = records.parse(opcode, stream.read(length))
    return isinstance(header, Header) and header.profile == PROFILE


def _crc(stream: IO[bytes], at: int, until: int, crc: int) -> int:
    stream.seek(at)
    while at < until and (block := stream.read(min(_BLOCK, until - at))):
        crc = zlib.crc32(block, crc)
        at += len(block)
    return crc
