"""A recording as a table: Parquet, HDF5 or CSV, chosen by the file's suffix.

Units: mm, kPa, us. Frames are handled in batches, so memory stays flat however long the recording is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from firmware_py import geometry, tables
from palpate.errors import MissingExtra, PalpateError
from palpate.files import by_suffix, whole_file
from palpate.recording.patient_file import PatientFile
from palpate.recording.playback import RecordedSession, open_recording
from palpate.recording.reader import Recording
from palpate.wire.events import Estimate, Frame

BATCH = 1000
CELLS = [f"p_{row}_{column}_kPa" for row in range(geometry.ROWS) for column in range(geometry.COLUMNS)]
"""Names of the pressure columns of a CSV file: row along the stroke, column across it."""

_NUMBERS = [
    *((name, np.dtype(np.int64)) for name in ("seq", "time_us", "host_time_ns")),
    *((name, np.dtype(np.float64)) for name in ("position_mm", "displacement_mm")),
    *((name, np.dtype(np.int64)) for name in ("lost_before", *tables.FRAME_MORE)),
]
"""What a table tells of a frame beside its pressures."""

Batch = dict[str, np.ndarray]


@dataclass(frozen=True)
class Converted:
    """What was written.

    Parameters
    ----------
    files : list of Path
        The table, and the one of the estimates beside it.
    frames, estimates, lost : int
        How many are in them, and how many frames the link had lost.
    calibrated : bool
        False where pressures are by the nominal scale, for want of the probe's calibration.
    """

    files: list[Path]
    frames: int
    estimates: int
    lost: int
    calibrated: bool


class _Sink(Protocol):
    """Takes frames batch by batch, and the estimates in the end."""

    def frames(self, batch: Batch) -> None: ...

    def finish(self, estimates: list[dict[str, Any]], about: dict[str, str]) -> None: ...


def convert(recording: str | Path, out: str | Path, overwrite: bool = False, to: str = "table") -> Converted:
    """Write a recording's frames and estimates as a table, or as messages.

    Parameters
    ----------
    recording : str or Path
        The .mcap file, finished or not.
    out : str or Path
        Ends in .parquet, .h5, .hdf5 or .csv.
    to : str
        "table"; "ros2": then `out` ends in .mcap; "lerobot": then it is a new directory.
    overwrite : bool
        Replace files that are there.

    Raises
    ------
    UnknownFormat
        Another suffix.
    NoSuchFile, NotARecording
        About the recording.
    DiskFull, PalpateError
        The table is there already, or could not be written; nothing is left of it.
    MissingExtra
        HDF5 needs h5py.
    """
    out = Path(out)
    write: Callable[..., Converted] = by_suffix(out, WRITERS[to])
    Recording(recording)
    if out.exists() and out.samefile(recording):
        raise PalpateError(f"{out} is the recording itself; choose another name")
    for path in () if overwrite and to != "lerobot" else (out, _beside(out)):
        if path.exists():
            raise PalpateError(f"{path} exists already; choose another name or give --overwrite")
    return write(Path(recording), out)


def _pump(recording: Path, sink: _Sink) -> tuple[int, int, int, bool]:
    """Everything in the recording through a sink: numbers of frames, estimates, lost frames; calibrated."""
    estimates: list[dict[str, Any]] = []
    about = {
        f"{name}.{key}": value
        for name, words in Recording(recording).metadata().items()
        for key, value in words.items()
    }
    count = 0
    with open_recording(recording) as session:
        for batch in _batches(session, estimates):
            count += len(batch["seq"])
            sink.frames(batch)
        lost = session.frame_counts.lost
        calibrated = session.scale.calibrated
    sink.finish(estimates, about | {"calibrated": str(calibrated).lower()})
    return count, len(estimates), lost, calibrated


def _batches(session: RecordedSession, estimates: list[dict[str, Any]]) -> Iterator[Batch]:
    waiting: list[Frame] = []
    for event in session.events():
        if isinstance(event, Frame):
            waiting.append(event)
            if len(waiting) == BATCH:
                yield _batch(waiting)
                waiting.clear()
        elif isinstance(event, Estimate):
            estimates.append({"host_time_ns": event.host_ns, **event.as_dict()})
    if waiting:
        yield _batch(waiting)


def _batch(frames: list[Frame]) -> Batch:
    told = [
        (f.seq, f.time_us, f.host_ns, f.position_um / 1000, f.displacement_um / 1000, f.lost_before, *f.more)
        for f in frames
    ]
    batch = {name: np.array(column, kind) for (name, kind), column in zip(_NUMBERS, zip(*told))}
    return {**batch, "pressure_kPa": np.stack([f.pressure_kPa for f in frames])}


def _flat(estimate: dict[str, Any]) -> dict[str, Any]:
    """An estimate as one row: d_mm, d_mm_low, d_mm_high and so on."""
    row: dict[str, Any] = {}
    for name, value in estimate.items():
        if isinstance(value, dict):
            row |= {name: value["value"], f"{name}_low": value["low"], f"{name}_high": value["high"]}
        else:
            row[name] = value
    return row


def _beside(out: Path) -> Path:
    return out.with_name(f"{out.stem}.estimates{out.suffix}")


def _to_csv(recording: Path, out: Path) -> Converted:
    import pandas as pd

    class Csv:
        def __init__(self, path: Path) -> None:
            self.stream = path.open("w", newline="")
            self.header = True

        def frames(self, batch: Batch) -> None:
            pressures = batch["pressure_kPa"].reshape(-1, len(CELLS))
            table = pd.DataFrame({name: column for name, column in batch.items() if name != "pressure_kPa"})
            table = pd.concat([table, pd.DataFrame(pressures, columns=CELLS)], axis=1)
            table.to_csv(self.stream, index=False, header=self.header, float_format="%.5g")
            self.header = False

        def finish(self, estimates: list[dict[str, Any]], about: dict[str, str]) -> None:
            if self.header:
                self.stream.write(",".join([*(name for name, _ in _NUMBERS), *CELLS]) + "\n")
            self.stream.close()
            pd.DataFrame([_flat(e) for e in estimates]).to_csv(beside, index=False)

    with whole_file(_beside(out)) as beside, whole_file(out) as path:
        counts = _pump(recording, Csv(path))
    return Converted([out, _beside(out)], *counts)


def _to_parquet(recording: Path, out: Path) -> Converted:
    import pyarrow as pa
    import pyarrow.parquet as pq

    numbers = [(name, pa.from_numpy_dtype(kind)) for name, kind in _NUMBERS]
    schema = pa.schema([*numbers, ("pressure_kPa", pa.list_(pa.float32(), len(CELLS)))])

    class Parquet:
        def __init__(self, stream: PatientFile) -> None:
            about = {f"palpate.{k}": v for k, v in session.items()}
            self.stream = stream
            self.writer = pq.ParquetWriter(stream, schema.with_metadata(about), compression="zstd")

        def frames(self, batch: Batch) -> None:
            flat = pa.array(batch["pressure_kPa"].reshape(-1))
            columns = [pa.array(batch[name]) for name in schema.names[:-1]]
            columns.append(pa.FixedSizeListArray.from_arrays(flat, len(CELLS)))
            self.writer.write_table(pa.Table.from_arrays(columns, schema=self.writer.schema))
            self.stream.check()

        def finish(self, estimates: list[dict[str, Any]], about: dict[str, str]) -> None:
            self.writer.close()
            self.stream.check()
            pq.write_table(pa.Table.from_pylist([_flat(e) for e in estimates]), beside, compression="zstd")

    session = Recording(recording).metadata().get("session", {})
    with whole_file(_beside(out)) as beside, whole_file(out) as path, PatientFile(path) as stream:
        counts = _pump(recording, Parquet(stream))
    return Converted([out, _beside(out)], *counts)


def _to_hdf5(recording: Path, out: Path) -> Converted:
    try:
        import h5py
    except ImportError:
        raise MissingExtra("h5py", "hdf5", "writing HDF5") from None

    class Hdf5:
        def __init__(self, file: Any, stream: PatientFile) -> None:
            self.file, self.stream = file, stream
            self.group = file.create_group("frames")

        def frames(self, batch: Batch) -> None:
            for name, column in batch.items():
                if name not in self.group:
                    rest = column.shape[1:]
                    self.group.create_dataset(
                        name, data=column, maxshape=(None, *rest), chunks=(256, *rest), compression="gzip"
                    )
                    continue
                dataset = self.group[name]
                dataset.resize(len(dataset) + len(column), axis=0)
                dataset[-len(column) :] = column
            self.file.flush()
            self.stream.check()

        def finish(self, estimates: list[dict[str, Any]], about: dict[str, str]) -> None:
            self.file.attrs.update(about)
            rows = [_flat(e) for e in estimates]
            group = self.file.create_group("estimates")
            for name in rows[0] if rows else ():
                column = [row.get(name) for row in rows]
                if any(isinstance(value, str) for value in column):
                    group.create_dataset(
                        name, data=[value or "" for value in column], dtype=h5py.string_dtype()
                    )
                elif None in column:  # a bound that is not there
                    group.create_dataset(name, data=[np.nan if v is None else float(v) for v in column])
                else:
                    group.create_dataset(name, data=column)

    with whole_file(out) as path, PatientFile(path) as stream:
        with h5py.File(stream, "w") as file:
            counts = _pump(recording, Hdf5(file, stream))
        stream.check()
    return Converted([out], *counts)


def _to_ros2(recording: Path, out: Path) -> Converted:
    from palpate.recording.ros2 import to_ros2

    return Converted([out], *to_ros2(recording, out))


def _to_lerobot(recording: Path, out: Path) -> Converted:
    from palpate.recording.lerobot import to_lerobot

    return Converted([out], *to_lerobot(recording, out))


WRITERS: dict[str, dict[str, Callable[..., Converted]]] = {
    "table": {".parquet": _to_parquet, ".h5": _to_hdf5, ".hdf5": _to_hdf5, ".csv": _to_csv},
    "ros2": {".mcap": _to_ros2},
    "lerobot": {"": _to_lerobot},
}
"""What can be written: the file's suffix -> its writer."""
