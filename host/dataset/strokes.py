"""A data set's strokes: their frames out of the recordings, through the probe's integers, to features."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from firmware_py import calib
from palpate.dataset.checks import fault
from palpate.dataset.table import DataSet
from palpate.errors import PalpateError
from palpate.features.map_features import Floats
from palpate.firmware_twin.replay_core import Replay
from palpate.learn.observed import NAMES, OF_THE_DISPLACEMENT
from palpate.model_export.integers import force_map as force_maps
from palpate.model_export.schema import ModelSpec
from palpate.progress import ProgressCallback
from palpate.recording.channels import IMPORT_NOTE
from palpate.recording.playback import open_recording
from palpate.stroke.session_frames import SessionFrames
from palpate.wire.events import Estimate


@dataclass(frozen=True)
class RecordedStroke:
    """The frames that one estimate rests on.

    Attributes
    ----------
    packed : list of bytes
    positions_um, displacements_um, times_us : (n,), int
    calibration : calib.Calibration
    press : (packed frames, displacements_um)
        Of the press before it; both empty where it is not whole.
    missing : frozenset of str
        "displacement", "position", "time": what the recording was imported without.
    """

    packed: list[bytes]
    positions_um: NDArray[np.int64]
    displacements_um: NDArray[np.int64]
    times_us: NDArray[np.int64]
    calibration: calib.Calibration
    press: tuple[list[bytes], list[int]]
    missing: frozenset[str]


def read_strokes(path: str | Path) -> dict[int, RecordedStroke]:
    """All strokes of a recording whose frames are whole, by number.

    Raises
    ------
    NoSuchFile, NotARecording, RecordingError
    """
    frames = SessionFrames()
    found: dict[int, RecordedStroke] = {}
    with open_recording(path) as session:
        own = session.recording.calibration()
        said = session.recording.metadata().get(IMPORT_NOTE, {}).get("missing", "")
        missing = frozenset(said.split())
        for event in session.events():
            frames.take(event)
            if isinstance(event, Estimate) and not (of := frames.of(event)).missing:
                felt, press = of.stroke, of.press or []
                found[event.stroke] = RecordedStroke(
                    [frame.packed for frame in felt],
                    np.array([frame.position_um for frame in felt], np.int64),
                    np.array([frame.displacement_um for frame in felt], np.int64),
                    np.array([frame.time_us for frame in felt], np.int64),
                    own,
                    ([frame.packed for frame in press], [frame.displacement_um for frame in press]),
                    missing,
                )
    return found


@dataclass(frozen=True)
class ObservedDataSet:
    """A data set's strokes as a model sees them, one for each row.

    Attributes
    ----------
    table : DataFrame
        The data set's rows.
    X : (n, features)
        Every feature of the firmware, by `learn.observed.NAMES`.
    status : (n), int
        The pipeline's status.
    """

    table: pd.DataFrame
    X: Floats
    status: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.status)

    def take(self, rows: NDArray[np.bool_]) -> ObservedDataSet:
        """Some of the strokes."""
        return ObservedDataSet(self.table[rows].reset_index(drop=True), self.X[rows], self.status[rows])

    @property
    def lump(self) -> NDArray[np.int64]:
        """Which lump each stroke is over, counted from 0 in the order of the table."""
        return np.asarray(pd.factorize(self.table["lump"])[0], np.int64)


def observe_data_set(
    data: DataSet, spec: ModelSpec, progress: ProgressCallback | None = None
) -> ObservedDataSet:
    """Every stroke of a data set through the probe's integer pipeline, as the model wants it.

    Parameters
    ----------
    data : DataSet
    spec : ModelSpec
        Its force map is used, and what it needs must be there.
    progress : callable, optional
        See `palpate.progress.ProgressCallback`.

    Raises
    ------
    DataSetError
        A recording cannot be read, has no such stroke, or lacks what the model needs: row and column.
    """
    replay = Replay(None if spec.force_map is None else force_maps.blob(spec.force_map))
    X, codes = np.zeros((len(data), len(NAMES))), np.zeros(len(data), int)
    recordings: dict[Path, dict[int, RecordedStroke]] = {}
    rows = zip(data.table["row"], data.table["recording"], data.table["stroke"])
    for k, (row, path, number) in enumerate(rows):
        if path not in recordings:
            recordings.clear()  # a table lists a recording's strokes together; memory stays flat
            recordings[path] = _read(row, path)
        stroke = recordings[path].get(number)
        if stroke is None:
            there = ", ".join(map(str, recordings[path])) or "none"
            raise fault(row, "stroke", f"{path.name} has no whole stroke {number}; it has {there}")
        _check_needs(row, path, stroke, spec)
        codes[k] = replay.stroke(
            stroke.packed, stroke.positions_um, stroke.displacements_um, stroke.calibration, stroke.press
        )
        X[k] = replay.features()
        if progress is not None:
            progress("strokes read", k + 1, len(data))
    return ObservedDataSet(data.table, X, codes)


def _read(row: int, path: Path) -> dict[int, RecordedStroke]:
    try:
        return read_strokes(path)
    except PalpateError as error:
        raise fault(row, "recording", str(error)) from error


def _check_needs(row: int, path: Path, stroke: RecordedStroke, spec: ModelSpec) -> None:
    if "displacement" in stroke.missing:
        first = spec.first.features if spec.first else ()
        needed = [name for name in (*spec.features, *first) if name in OF_THE_DISPLACEMENT]
        if not needed and (spec.force_map or {}).get("ln_D") is not None:
            needed = ["it to even out the force"]
        if needed:
            what = f"{path.name} has no displacement, and the model needs {needed[0]}"
            raise fault(
                row, "recording", f"{what}; palpate fit --without displacement makes one that does not"
            )
