"""Recording a session as MCAP while it runs.

The wire goes in byte for byte (both directions, damaged packets too), with the host's time as log time and
the probe's as publish time; beside it the decoded topics of `channels`. Each packet is committed as it comes,
so that `kill -9` costs at most the packet in flight. Closing rewrites the journal as an indexed, compressed
MCAP file and puts it in the journal's place in one step.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import threading
import time
from pathlib import Path
from typing import Any, Self

from mcap.records import Attachment, Message, Metadata
from mcap.writer import CompressionType, Writer

from palpate.errors import RecordingError, UnknownFormat
from palpate.recording import channels
from palpate.recording.journal import JournalFile
from palpate.recording.reader import PROFILE, Recording
from palpate.wire.events import Answer, Event

_log = logging.getLogger(__name__)

LIBRARY = "palpate recording 1"
CHUNK_BYTES = 1 << 18
"""Size of a sealed recording's chunks, unpacked: damage in one costs no other."""


def check_name(path: Path) -> None:
    """`UnknownFormat` where a recording's name does not end in .mcap."""
    if path.suffix != ".mcap":
        raise UnknownFormat(f"a recording's name ends in .mcap, not {path.name!r}")


class RecordingWriter:
    """A `Recorder` for `palpate.link.probe.Probe`; thread-safe: one thread sends, another reads.

    Parameters
    ----------
    path : str or Path
        Ends in .mcap.
    overwrite : bool
        Replace an existing file.
    metadata : dict, optional
        Words about the session; written first.

    Raises
    ------
    UnknownFormat
        The name does not end in .mcap.
    RecordingError
        The file exists or cannot be created; `DiskFull` while recording.
    """

    def __init__(
        self, path: str | Path, overwrite: bool = False, metadata: dict[str, str] | None = None
    ) -> None:
        self.path = Path(path)
        check_name(self.path)
        self.frames = 0
        self._journal = JournalFile(self.path, overwrite)
        _log.info("recording into %s", self.path)
        self._lock = threading.Lock()
        self._closed = False
        self._in_place = False
        self._failure: RecordingError | None = None
        stream: Any = self._journal
        self._mcap = Writer(
            stream, use_chunking=False, compression=CompressionType.NONE, enable_data_crcs=True
        )
        self._mcap.start(PROFILE, LIBRARY)
        self._channels = _register(self._mcap)
        self._mcap.add_metadata("session", {"started_ns": str(time.time_ns()), **(metadata or {})})
        try:
            self._journal.commit()
        except RecordingError:
            self._journal.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def received(self, raw: bytes, event: Event | None, host_ns: int) -> None:
        """Bytes from the probe up to and including the packet that made `event` (None: no packet)."""
        device_us = None if event is None else channels.device_time_us(event)
        messages = [] if event is None or isinstance(event, Answer) else channels.decoded(event)
        with self._lock:
            self._add(channels.WIRE_IN, host_ns, raw, device_us)
            for topic, text in messages:
                self._add(topic, host_ns, text, device_us)
            self._commit()
        if messages and messages[0][0] == channels.IMAGE:
            self.frames += 1

    def sent(self, raw: bytes, host_ns: int) -> None:
        """Bytes to the probe."""
        with self._lock:
            self._add(channels.WIRE_OUT, host_ns, raw, None)
            self._commit()

    def mark(self, event: Event) -> None:
        """Something that did not come over the wire: the link went down, or is up again."""
        with self._lock:
            for topic, text in channels.decoded(event):
                self._add(topic, event.host_ns, text, None)
            self._commit()

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Put a file into the recording: the model image, the calibration."""
        with self._lock:
            now = time.time_ns()
            self._mcap.add_attachment(now, now, name, media_type, data)
            self._commit()

    def note(self, name: str, words: dict[str, str]) -> None:
        """Words about the session that came to light later (the probe's identity, the clock, the counts)."""
        with self._lock:
            self._mcap.add_metadata(name, words)
            self._commit()

    def check(self) -> None:
        """Raise what ended the recording early (a full disk) or damaged it, if anything did."""
        if self._failure is not None:
            raise self._failure

    def close(self, seal: bool = True) -> None:
        """Finish the file; with `seal` also index and compress it. Harmless when repeated."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            try:
                if self._failure is None:
                    self._mcap.finish()
                    self._journal.commit()
            finally:
                self._in_place = self._journal.in_place()
                self._journal.close()
        _log.info("closed %s after %d frames", self.path, self.frames)
        if seal and self._failure is None and self._in_place:
            # Sealing is a convenience for readers: without room for it the plain file stays.
            with contextlib.suppress(OSError):
                try:
                    seal_file(self.path)
                except RecordingError as error:
                    self._failure = error

    def discard(self) -> None:
        """Close and remove the file: there was nothing to record."""
        self.close(seal=False)
        if self._in_place:  # and no recording that was written over it since
            self.path.unlink(missing_ok=True)

    def _add(self, topic: str, host_ns: int, data: bytes, device_us: int | None) -> None:
        # negative just after the probe's start, where the first time read was past the counter's wrap
        publish_ns = host_ns if device_us is None else max(0, 1000 * device_us)
        self._mcap.add_message(self._channels[topic], host_ns, data, publish_ns)

    def _commit(self) -> None:
        """A full disk ends the recording, not the session: the link's thread goes on, `check` tells."""
        if self._failure is not None or self._closed:
            self._journal.drop()
            return
        try:
            self._journal.commit()
        except RecordingError as error:
            self._failure = error


def seal_file(path: Path) -> None:
    """Rewrite a finished recording with chunks, compression and an index.

    Parameters
    ----------
    path : Path
        Replaced in one step, once what stands in its place was read back; on any error it stays as it was.

    Raises
    ------
    RecordingError
        It is damaged or has no end: replacing it would lose what a better reader may still find.
    """
    recording = Recording(path)
    if not recording.finished:
        raise RecordingError(f"{path} has no end (its writer was stopped); it was left as it is")
    temporary = path.with_name(f".{path.name}.{os.getpid()}.seal")
    try:
        with temporary.open("wb") as stream:
            writer = Writer(stream, CHUNK_BYTES, CompressionType.ZSTD, enable_data_crcs=True)
            writer.start(PROFILE, LIBRARY)
            known = _register(writer)
            digest = _copy(recording, writer, known)
            writer.finish()
            stream.flush()
            os.fsync(stream.fileno())
        if recording.damage:
            raise RecordingError(f"{recording.damage}; it was left as it is")
        sealed = Recording(temporary)
        if _copy(sealed, None, known) != digest or sealed.damage:
            raise RecordingError(f"{path} could not be sealed: what was written reads differently; it stays")
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _copy(recording: Recording, writer: Writer | None, known: dict[str, int]) -> str:
    """All records into `writer`; returns a digest of them: attachments, words and messages, each in order."""
    digests = {kind: hashlib.sha256() for kind in (Message, Attachment, Metadata)}
    for topic, record in recording.records():
        digests[type(record)].update(repr((topic, record)).encode())  # type: ignore[index]
        if writer is None:
            continue
        if isinstance(record, Message):
            writer.add_message(
                known[topic], record.log_time, record.data, record.publish_time, record.sequence
            )
        elif isinstance(record, Attachment):
            writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
    return "".join(digest.hexdigest() for digest in digests.values())


def _register(writer: Writer) -> dict[str, int]:
    """All topics of a recording; returns their channel ids."""
    ids = {topic: writer.register_channel(topic, channels.WIRE_ENCODING, 0) for topic in channels.WIRES}
    for topic in channels.SCHEMAS:  # in the order of `channels.BY_ID`
        name, schema = channels.schema_json(topic)
        schema_id = writer.register_schema(name, "jsonschema", schema)
        metadata = {"unit": "Pa"} if topic == channels.IMAGE else {}
        ids[topic] = writer.register_channel(topic, "json", schema_id, metadata)
    return ids
