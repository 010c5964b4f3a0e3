"""A recording as a LeRobot dataset (version 3.0 of its layout): one episode, without LeRobot itself.

A directory: data/chunk-000/file-000.parquet, and under meta/ info.json, stats.json, tasks.parquet and
episodes/chunk-000/file-000.parquet. Features: observation.tactile (rows x columns, kPa) and observation.state
(position, displacement, force: mm, mm, N). LeRobot wants frames at a fixed rate: each moment takes the newest
frame there is. There is no action in it: that is the robot's.

Source of the layout: huggingface.co/docs/lerobot, "LeRobotDataset v3.0".
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import geometry
from palpate.errors import PalpateError
from palpate.files import cannot_write
from palpate.recording.playback import open_recording
from palpate.wire.cells import PITCH_MM
from palpate.wire.events import Frame

VERSION = "v3.0"
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
TACTILE, STATE = "observation.tactile", "observation.state"
_COUNTED = ("frame_index", "episode_index", "index", "task_index")
FEATURES: dict[str, dict[str, Any]] = {
    TACTILE: {
        "dtype": "float32",
        "shape": [geometry.ROWS, geometry.COLUMNS],
        "names": ["along", "across"],
    },
    STATE: {"dtype": "float32", "shape": [3], "names": ["position_mm", "displacement_mm", "force_N"]},
    "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    **{name: {"dtype": "int64", "shape": [1], "names": None} for name in _COUNTED},
}


def to_lerobot(recording: Path, out: Path, task: str = "palpate") -> tuple[int, int, int, bool]:
    """Write a recording as a LeRobot dataset.

    Parameters
    ----------
    recording : Path
    out : Path
        The dataset's directory; it must not be there.
    task : str
        What LeRobot calls the task of the episode.

    Returns
    -------
    Numbers of frames, estimates (none go in) and lost frames; whether the pressures are calibrated.

    Raises
    ------
    PalpateError
        There are fewer than two frames, or it cannot be written; nothing is left of it then.
    """
    with open_recording(recording) as session:
        frames = [event for event in session.events() if isinstance(event, Frame)]
        lost, calibrated = session.frame_counts.lost, session.scale.calibrated
    if len(frames) < 2:
        raise PalpateError(f"{recording} has too few frames for an episode: {len(frames)}")
    time_s = np.array([frame.time_us for frame in frames]) * 1e-6
    fps = max(1, round(1 / float(np.median(np.diff(time_s)))))
    grid_s = np.arange(int((time_s[-1] - time_s[0]) * fps) + 1) / fps
    taken = np.searchsorted(time_s - time_s[0], grid_s + 0.5 / fps, side="right") - 1
    kPa = np.stack([frame.pressure_kPa for frame in frames])[taken]
    force_N = kPa.sum(axis=(1, 2), dtype=float) * PITCH_MM**2 / 1000
    place = np.array([(frame.position_mm, frame.displacement_mm) for frame in frames])[taken]
    columns: dict[str, NDArray[Any]] = {
        TACTILE: kPa,
        STATE: np.column_stack([place, force_N]).astype(np.float32),
        "timestamp": grid_s.astype(np.float32),
        "frame_index": np.arange(len(taken)),
        "episode_index": np.zeros(len(taken), np.int64),
        "index": np.arange(len(taken)),
        "task_index": np.zeros(len(taken), np.int64),
    }
    temporary = out.with_name(f".{out.name}.part")
    try:
        shutil.rmtree(temporary, ignore_errors=True)
        _write(temporary, columns, fps, task)
        temporary.rename(out)
    except OSError as error:
        raise cannot_write(out, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return len(taken), 0, lost, calibrated


def _write(root: Path, columns: dict[str, NDArray[Any]], fps: int, task: str) -> None:
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq

    n = len(columns["index"])
    stats = {name: _stats(column) for name, column in columns.items()}
    episode = {
        "episode_index": 0,
        "tasks": [task],
        "length": n,
        "dataset_from_index": 0,
        "dataset_to_index": n,
        "data/chunk_index": 0,
        "data/file_index": 0,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
        **{f"stats/{name}/{kind}": value for name, each in stats.items() for kind, value in each.items()},
    }
    info = {
        "codebase_version": VERSION,
        "robot_type": "palpate",
        "total_episodes": 1,
        "total_frames": n,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": "0:1"},
        "data_path": DATA,
        "video_path": None,
        "features": FEATURES,
    }
    for folder in ("data/chunk-000", "meta/episodes/chunk-000"):
        (root / folder).mkdir(parents=True)
    table = pa.table({name: pa.array(column.tolist(), _type(column)) for name, column in columns.items()})
    pq.write_table(table, root / DATA.format(chunk_index=0, file_index=0))
    pq.write_table(pa.Table.from_pylist([episode]), root / "meta/episodes/chunk-000/file-000.parquet")
    pd.DataFrame({"task_index": [0]}, index=pd.Index([task], name="task")).to_parquet(
        root / "meta/tasks.parquet"
    )
    (root / "meta/info.json").write_text(json.dumps(info, indent=1))
    (root / "meta/stats.json").write_text(json.dumps(stats))


def _type(column: NDArray[Any]) -> Any:
    import pyarrow as pa

    kind = pa.from_numpy_dtype(column.dtype)
    for _ in column.shape[1:]:
        kind = pa.list_(kind)
    return kind


def _stats(column: NDArray[Any]) -> dict[str, Any]:
    """As LeRobot normalises by them: over the frames, of each number."""
    rows = column.reshape(len(column), *(column.shape[1:] or (1,))).astype(float)
    found = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
    return {**{name: value.tolist() for name, value in found.items()}, "count": [len(column)]}
