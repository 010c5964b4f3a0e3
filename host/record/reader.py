"""Reading recordings, finished or not: whatever is complete is read, the rest is said."""

from __future__ import annotations

import struct
from collections.abc import Generator
from pathlib import Path
from typing import IO, Any

from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader

from host.errors import NoSuchFile, NotARecording
from host.record import channels

MAGIC = b"\x89MCAP0\r\n"
_RECORD_HEAD = struct.Struct("<BQ")
_LONGEST_RECORD = 1 << 28


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
            with self.path.open("rb") as stream:
                self._length, self.finished = _complete_length(stream)
        except FileNotFoundError:
            raise NoSuchFile(f"there is no recording {path}; check the name") from None
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise NoSuchFile(f"the recording {path} cannot be read: {reason}") from error
        if self._length == 0:
            raise NotARecording(
                f"{path} is not a recording (no MCAP file); `palpate stream --record` makes one"
            )
        self.damage = ""
        """Where reading had to stop before the end, in words; "" so far."""

    def records(self) -> Generator[tuple[str, McapRecord]]:
        """Every message, attachment and metadata record with its topic ("" where it has none), in order."""
        topics: dict[int, str] = {}
        self.damage = ""
        with self.path.open("rb") as stream:
            bounded: Any = _Bounded(stream, self._length)
            try:
                for record in StreamReader(bounded, record_size_limit=_LONGEST_RECORD).records:
                    if isinstance(record, Channel):
                        topics[record.id] = record.topic
                    elif isinstance(record, Message):
                        yield topics.get(record.channel_id, ""), record
                    elif isinstance(record, Attachment | Metadata):
                        yield "", record
            except EOFError:
                return
            except (McapError, struct.error, ValueError, MemoryError, OverflowError) as error:
                if bounded.at < self._length:
                    self.damage = (
                        f"{self.path} is damaged near byte {bounded.at} ({error}); what follows is lost"
                    )

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
        found = None
        for _, record in self.records():
            if isinstance(record, Attachment) and record.name == name:
                found = record.data
        return found


class _Bounded:
    """A file that ends at the last complete record; `at` is how far it was read."""

    def __init__(self, stream: IO[bytes], length: int) -> None:
        self._stream = stream
        self._length = length
        self.at = 0

    def read(self, n: int) -> bytes:
        data = self._stream.read(max(0, min(n, self._length - self.at)))
        self.at += len(data)
        return data


def _complete_length(stream: IO[bytes]) -> tuple[int, bool]:
    """Bytes up to the end of the last complete record, and whether the file is finished; 0: no MCAP."""
    if stream.read(len(MAGIC)) != MAGIC:
        return 0, False
    size = stream.seek(0, 2)
    stream.seek(max(len(MAGIC), size - len(MAGIC)))
    if size > 2 * len(MAGIC) and stream.read() == MAGIC:
        return size, True
    at = len(MAGIC)
    while True:
        stream.seek(at)
        head = stream.read(_RECORD_HEAD.size)
        if len(head) < _RECORD_HEAD.size:
            return at, False
        opcode, length = _RECORD_HEAD.unpack(head)
        end = at + _RECORD_HEAD.size + length
        if opcode == 0 or end > size:
            return at, False
        at = end
