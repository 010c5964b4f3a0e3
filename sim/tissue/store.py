"""Where strokes are kept: a journal while a sweep runs, one Parquet table when it is done.

    DIR/strokes.parquet     one row per case, in the design's order, the same bytes however often the sweep
                            was interrupted
    DIR/timing.parquet      key and CPU time of each
    DIR/earlier.parquet     strokes of earlier designs that this one lacks; used again where a design has them
    DIR/finished.journal    only while a sweep is unfinished: every stroke as it came in
    DIR/.sweep.lock         held by the one sweep that may write here

A journal's record is length, CRC-32 and compressed JSON. A torn last record (the program was killed while
it wrote) is cut off; everything before it counts. Tables are written beside and renamed, after fsync.
"""

from __future__ import annotations

import errno
import json
import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO

import pyarrow as pa
import pyarrow.parquet as pq

from palpate.files import lock_file
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.records import SCHEMA, SOLID_SCHEMA, Record

_HEAD = struct.Struct("<4sII")
_MAGIC = b"STRK"
_LONGEST = 1 << 24
_ROWS = 4096


class StrokeStore:
    """The strokes of one directory.

    Parameters
    ----------
    directory : Path
        Made if it is missing.

    Raises
    ------
    CaseError
        Another sweep is writing into it.
    """

    def __init__(self, directory: Path) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        self._lock = _lock(directory)
        self.table_path = directory / "strokes.parquet"
        self.earlier_path = directory / "earlier.parquet"
        self.timing_path = directory / "timing.parquet"
        self.journal_path = directory / "finished.journal"
        self._places: dict[str, int] = {}
        self._rows: dict[str, tuple[Path, int, int]] = {}
        self._journal = open(self.journal_path, "a+b")  # noqa: SIM115 (closed in close)
        self._journal.seek(self._scan())
        self._journal.truncate()
        for path in (self.earlier_path, self.table_path):
            if path.exists():
                table = pq.ParquetFile(path)
                for group in range(table.num_row_groups):
                    keys = table.read_row_group(group, columns=["key"])["key"].to_pylist()
                    self._rows.update({key: (path, group, row) for row, key in enumerate(keys)})
        self._synced = 0

    def __contains__(self, key: str) -> bool:
        return key in self._places or key in self._rows

    def add(self, record: Record) -> None:
        """Put a finished stroke into the journal; it survives the end of this process at once."""
        # A flat probe's radius is infinite, which Python's JSON reads back; results were checked before.
        body = zlib.compress(json.dumps(record, separators=(",", ":")).encode(), 1)
        place = self._journal.seek(0, os.SEEK_END)
        self._journal.write(_HEAD.pack(_MAGIC, len(body), zlib.crc32(body)) + body)
        self._journal.flush()
        self._places[record["key"]] = place

    def sync(self) -> None:
        """Make the journal survive a loss of power too."""
        os.fsync(self._journal.fileno())

    def seal(self, keys: Sequence[str], solid: bool = False) -> None:
        """Write the table of `keys`, in their order, and drop the journal; `solid` if any lump is.

        What else was finished here goes into the table of earlier strokes.
        """
        timing = dict(self._old_timing())
        wanted = set(keys)
        others = sorted(key for key in {*self._rows, *self._places} if key not in wanted)
        if others:
            self._write(self.earlier_path, others, SOLID_SCHEMA, timing)
        self._write(self.table_path, keys, SOLID_SCHEMA if solid else SCHEMA, timing)
        every = [*keys, *others]
        timing_table = pa.table({"key": every, "cpu_s": [timing.get(key, 0.0) for key in every]})
        pq.write_table(timing_table, _beside(self.timing_path))
        _move_into_place(self.timing_path)
        if others:  # first: a stroke may stand in both tables for a moment, and never in none
            _move_into_place(self.earlier_path)
        _move_into_place(self.table_path)
        if not others:
            self.earlier_path.unlink(missing_ok=True)
        self._journal.close()
        self.journal_path.unlink()
        self._lock.close()

    def _write(self, path: Path, keys: Sequence[str], schema: pa.Schema, timing: dict[str, float]) -> None:
        """A table of `keys` beside `path`; the CPU times of new ones go into `timing`."""
        old: dict[Path, pq.ParquetFile] = {}
        held: tuple[tuple[Path, int] | None, list[Record]] = (None, [])
        with pq.ParquetWriter(_beside(path), schema, compression="zstd") as writer:
            for first in range(0, len(keys), _ROWS):
                rows = []
                for key in keys[first : first + _ROWS]:
                    if key in self._places:
                        record = self._read(self._places[key])
                        timing[key] = record.pop("cpu_s")
                    else:
                        home, group, row = self._rows[key]
                        if held[0] != (home, group):
                            table = old.setdefault(home, pq.ParquetFile(home))
                            held = ((home, group), table.read_row_group(group).to_pylist())
                        record = held[1][row]
                    rows.append(record)
                writer.write_table(pa.Table.from_pylist(rows, schema), row_group_size=_ROWS)

    def close(self) -> None:
        """Leave everything as it is, to go on later."""
        self._journal.close()
        self._lock.close()

    def _old_timing(self) -> Iterator[tuple[str, float]]:
        if self.timing_path.exists():
            table = pq.read_table(self.timing_path)
            yield from zip(table["key"].to_pylist(), table["cpu_s"].to_pylist())

    def _scan(self) -> int:
        """Index the journal; returns where its last whole record ends."""
        self._journal.seek(0)
        place = 0
        while len(head := self._journal.read(_HEAD.size)) == _HEAD.size:
            magic, length, crc = _HEAD.unpack(head)
            if magic != _MAGIC or length > _LONGEST:
                break
            body = self._journal.read(length)
            if len(body) < length or zlib.crc32(body) != crc:
                break
            self._places[json.loads(zlib.decompress(body))["key"]] = place
            place += _HEAD.size + length
        return place

    def _read(self, place: int) -> Record:
        self._journal.seek(place)
        _, length, _ = _HEAD.unpack(self._journal.read(_HEAD.size))
        record: Record = json.loads(zlib.decompress(self._journal.read(length)))
        return record


def _lock(directory: Path) -> IO[bytes]:
    """The directory's lock; it ends with this process, however that ends."""
    file = open(directory / ".sweep.lock", "a+b")  # noqa: SIM115 (held as long as the store)
    try:
        lock_file(file, wait=False)
    except OSError as error:
        file.close()
        if error.errno not in (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK):
            raise
        raise CaseError(
            f"another sweep is running into {directory}; wait until it ends, or choose another directory"
        ) from None
    return file


def _beside(path: Path) -> Path:
    return path.with_name(path.name + ".partial")


def _move_into_place(path: Path) -> None:
    with open(_beside(path), "rb+") as file:
        os.fsync(file.fileno())
    os.replace(_beside(path), path)
    if os.name == "posix":
        directory = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)
