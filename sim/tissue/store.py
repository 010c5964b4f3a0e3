"""Where strokes are kept: a journal while a sweep runs, one Parquet table when it is done.

    DIR/strokes.parquet     one row per case, in the design's order, the same bytes however often the sweep
                            was interrupted
    DIR/timing.parquet      key and CPU time of each
    DIR/finished.journal    only while a sweep is unfinished: every stroke as it came in

A journal's record is length, CRC-32 and compressed JSON. A torn last record (the program was killed while
it wrote) is cut off; everything before it counts. Tables are written beside and renamed, after fsync.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from sim.tissue.case import Case
from sim.tissue.errors import CaseError
from sim.tissue.result import Stroke

Record = dict[str, Any]

_HEAD = struct.Struct("<4sII")
_MAGIC = b"STRK"
_LONGEST = 1 << 24
_ROWS = 4096

_LISTS = (
    "positions_mm",
    "displacement_mm",
    "images_kPa",
    "peak_mm",
    "peak_kPa",
    "contact_mm",
    "force_error",
    "smallest_jacobian",
    "iterations",
)
SCHEMA = pa.schema(
    [(name, pa.string()) for name in ("key", "code", "status", "reason")]
    + [(f.name, pa.float64()) for f in fields(Case)]
    + [("t_mm", pa.float64()), ("F_N_per_m", pa.float64())]
    + [(name, pa.list_(pa.float64())) for name in _LISTS[:-1]]
    + [("iterations", pa.list_(pa.int32())), ("factorisations", pa.int32()), ("nodes", pa.int32())]
)


def record_of(key: str, case: Case, result: Stroke | Exception) -> Record:
    """One row of the table, and the CPU time beside it."""
    record: Record = {
        "key": key,
        "code": case.code,
        **asdict(case),
        "t_mm": case.t_mm,
        "F_N_per_m": case.F_N_per_m,
    }
    if not isinstance(result, Stroke):
        empty: Record = {name: [] for name in _LISTS}
        return (
            record
            | empty
            | {"status": "failed", "reason": str(result), "factorisations": 0, "nodes": 0, "cpu_s": 0.0}
        )
    record |= {name: getattr(result, name).ravel().tolist() for name in _LISTS}
    record |= {"status": "ok", "reason": "", "factorisations": result.factorisations, "nodes": result.nodes}
    return record | {"cpu_s": result.cpu_s}


def stroke_of(record: Record) -> Stroke:
    """The stroke of a row whose status is `ok`; `CaseError` if another version of us wrote it."""
    try:
        case = {f.name: record[f.name] for f in fields(Case)}
        return Stroke.from_dict({**record, "case": case, "cpu_s": record.get("cpu_s", 0.0)})
    except KeyError as missing:
        raise CaseError(
            f"the sweep was stored by another version (it lacks {missing.args[0]}); "
            "run palpate sweep again with the same --out"
        ) from None


class StrokeStore:
    """The strokes of one directory.

    Parameters
    ----------
    directory : Path
        Made if it is missing.
    """

    def __init__(self, directory: Path) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        self.table_path = directory / "strokes.parquet"
        self.timing_path = directory / "timing.parquet"
        self.journal_path = directory / "finished.journal"
        self._places: dict[str, int] = {}
        self._rows: dict[str, tuple[int, int]] = {}
        self._journal = open(self.journal_path, "a+b")  # noqa: SIM115 (closed in close)
        self._journal.seek(self._scan())
        self._journal.truncate()
        if self.table_path.exists():
            table = pq.ParquetFile(self.table_path)
            for group in range(table.num_row_groups):
                keys = table.read_row_group(group, columns=["key"])["key"].to_pylist()
                self._rows.update({key: (group, row) for row, key in enumerate(keys)})
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

    def seal(self, keys: Sequence[str]) -> None:
        """Write the table of `keys`, in their order, and drop the journal."""
        timing = dict(self._old_timing())
        old = pq.ParquetFile(self.table_path) if self._rows else None
        held: tuple[int, list[Record]] = (-1, [])
        with pq.ParquetWriter(_beside(self.table_path), SCHEMA, compression="zstd") as writer:
            for first in range(0, len(keys), _ROWS):
                rows = []
                for key in keys[first : first + _ROWS]:
                    if key in self._places:
                        record = self._read(self._places[key])
                        timing[key] = record.pop("cpu_s")
                    else:
                        group, row = self._rows[key]
                        if held[0] != group:
                            assert old is not None
                            held = (group, old.read_row_group(group).to_pylist())
                        record = held[1][row]
                    rows.append(record)
                writer.write_table(pa.Table.from_pylist(rows, SCHEMA), row_group_size=_ROWS)
        timing_table = pa.table({"key": list(keys), "cpu_s": [timing.get(key, 0.0) for key in keys]})
        pq.write_table(timing_table, _beside(self.timing_path))
        _move_into_place(self.timing_path)
        _move_into_place(self.table_path)
        self._journal.close()
        self.journal_path.unlink()

    def close(self) -> None:
        """Leave everything as it is, to go on later."""
        self._journal.close()

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
