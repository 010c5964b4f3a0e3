"""Reading somebody's frames: CSV, Parquet, NPZ, HDF5, or a recording of ours. Units: kPa, mm, s."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.csv_dialect import dialect_of
from palpate.errors import MissingExtra, NoSuchFile, UsageError
from palpate.files import by_suffix, check_readable
from palpate.importing import published
from palpate.importing.declaration import Declaration

Floats = NDArray[np.float64]

LARGEST = 1 << 26
"""Bytes that a file may unpack to whatever its size; and `EXPANSION` times its size beyond."""
EXPANSION = 100
MOST_READ = 1 << 32
"""Bytes of a file."""
LESS = "/xela/data"
"""A dataset by whose name LESS' layout is known."""
FARTHEST_MM = 1000.0
"""Places and displacements."""
LONGEST_S = 86_400.0
GREATEST_KPA = 1e6


class ImportFailed(UsageError):
    """A file of frames is not what its declaration says; the sentence names the place."""


@dataclass(frozen=True)
class GivenFrames:
    """Frames of any array.

    Attributes
    ----------
    pressure_kPa : (n, rows, columns)
        Row along the stroke.
    position_mm : (n,)
    displacement_mm : (n,)
        0 where there is none.
    time_s : (n,)
    stroke : (n,), int
        Which stroke each frame belongs to.
    missing : tuple of str
        What was not there: displacement, position, time.
    """

    pressure_kPa: Floats
    position_mm: Floats
    displacement_mm: Floats
    time_s: Floats
    stroke: NDArray[np.int64]
    missing: tuple[str, ...]


class _Source(Protocol):
    """A file's named arrays."""

    names: list[str]

    def get(self, name: str) -> NDArray[Any]: ...


def read(path: str | Path, said: Declaration) -> GivenFrames:
    """Read a file as its declaration says.

    Raises
    ------
    NoSuchFile, UnknownFormat, MissingExtra
        The file itself; HDF5 needs h5py.
    ImportFailed
        A column is missing, of another length or shape, or holds what is no number: the sentence says where.
    """
    path = Path(path)
    openers: dict[str, Callable[[Path], _Source]] = {
        ".csv": _table, ".parquet": _table, ".npz": _npz, ".h5": _hdf5, ".hdf5": _hdf5, ".mat": _presses
    }  # fmt: skip
    source = by_suffix(path, openers)(path)
    return assemble(source, said, path.name)


def assemble(source: _Source, said: Declaration, name: str) -> GivenFrames:
    """Frames from named arrays; `name` is the file's, for sentences."""
    raw = _pressure(source, said, name)
    n = len(raw)
    if n < 2:
        raise ImportFailed(f"{name} holds {n} frames; a stroke takes more")
    pressure = said.kPa * (raw - said.zero)
    if said.zero_frames > n:
        raise ImportFailed(f"{name} holds {n} frames; the declaration takes its zero from {said.zero_frames}")
    if said.zero_frames:
        pressure = pressure - pressure[: said.zero_frames].mean(axis=0)
    _fill_dead(pressure, said, name)
    _within(np.abs(pressure).reshape(n, -1).max(1), GREATEST_KPA, "kPa", f"{name}, {{}}")
    missing = []
    stroke = np.zeros(n, np.int64)
    if said.stroke:
        stroke = np.unique(_column(source, said.stroke, n, name), return_inverse=True)[1]
    if said.time:
        time = said.time_s * _column(source, said.time, n, name)
        back = np.flatnonzero((np.diff(time) <= 0) & (np.diff(stroke) == 0))
        if len(back):
            raise ImportFailed(f"{name}, frame {back[0] + 1}, {said.time}: time does not go on")
    else:
        time = np.arange(n) / said.frames_per_s
        missing.append("time")
    _within(
        time - time[0], LONGEST_S, "s from the first frame", f"{name}, {{}}, {said.time or 'frames_per_s'}"
    )
    if said.position:
        position = said.position_mm * _column(source, said.position, n, name)
        _within(position, FARTHEST_MM, "mm", f"{name}, {{}}, {said.position}")
    else:
        position = np.empty(n)
        for k in np.unique(stroke):
            own = stroke == k
            position[own] = said.constant_mm_per_s * (time[own] - time[own].mean())
        missing.append("position")
    if said.displacement:
        depth = said.displacement_mm * _column(source, said.displacement, n, name)
        _within(depth, FARTHEST_MM, "mm", f"{name}, {{}}, {said.displacement}")
    else:
        depth = np.zeros(n)
        missing.append("displacement")
    return GivenFrames(pressure, position, depth, time, stroke.astype(np.int64), tuple(missing))


def _within(values: Floats, most: float, unit: str, where: str) -> None:
    """Refuse numbers that are none of a hand's stroke: their unit is another one."""
    if len(beyond := np.flatnonzero(~(np.abs(values) <= most))):
        place = where.format(f"frame {beyond[0]}")
        raise ImportFailed(f"{place}: {values[beyond[0]]:.3g} {unit} is none of a stroke; look at the unit")


def _pressure(source: _Source, said: Declaration, name: str) -> Floats:
    cells = said.cell_names()
    if not cells:
        found = np.asarray(_named(source, said.pressure, name))
        if found.dtype == object:  # a table's column of lists
            found = _rows(found, said, name)
        if found.ndim < 2 or found[0:1].size != min(len(found), 1) * said.rows * said.columns:
            raise ImportFailed(
                f"{name}, {said.pressure}: {found.shape} are no frames of {said.rows} x {said.columns}"
            )
        return _numbers(found, said.pressure, name).reshape(len(found), said.rows, said.columns)
    from_one = said.cell_names(first=1)
    if set(from_one) <= set(source.names):  # rows and columns are counted from 1, as spreadsheets do
        cells = from_one
    missing = [cell for cell in cells if cell not in source.names]
    if missing:
        raise ImportFailed(
            f"{name} has no column {missing[0]}: {said.rows} x {said.columns} cells need {len(cells)} "
            f"columns, and {len(cells) - len(missing)} are there"
        )
    table = np.column_stack([_numbers(_named(source, cell, name), cell, name) for cell in cells])
    return table.reshape(len(table), said.rows, said.columns)


def _rows(found: NDArray[Any], said: Declaration, name: str) -> Floats:
    """A table's column of lists, each a frame."""
    cells = said.rows * said.columns
    rows = np.empty((len(found), cells))
    for k, row in enumerate(found):
        try:
            frame = np.asarray(row, float)
        except (TypeError, ValueError):
            raise ImportFailed(f"{name}, frame {k}, {said.pressure}: it is no list of numbers") from None
        if frame.size != cells:
            raise ImportFailed(
                f"{name}, frame {k}, {said.pressure}: {frame.size} numbers are no frame of "
                f"{said.rows} x {said.columns}"
            )
        rows[k] = frame.reshape(-1)
    return rows


def _named(source: _Source, wanted: str, name: str) -> NDArray[Any]:
    if wanted not in source.names:
        there = ", ".join(source.names[:8]) + (" ..." if len(source.names) > 8 else "")
        raise ImportFailed(f"{name} has no {wanted!r}; it has {there}")
    try:
        return source.get(wanted)
    except ImportFailed:
        raise
    except Exception as error:  # whatever a damaged part makes of a reader of others
        raise ImportFailed(f"{name}, {wanted}: it cannot be read: {_first_line(error)}") from None


def _column(source: _Source, wanted: str, n: int, name: str) -> Floats:
    values = _numbers(_named(source, wanted, name), wanted, name).reshape(-1)
    if len(values) != n:
        raise ImportFailed(f"{name}, {wanted}: {len(values)} values for {n} frames")
    if not np.isfinite(values).all():
        raise ImportFailed(f"{name}, frame {np.flatnonzero(~np.isfinite(values))[0]}, {wanted}: not a number")
    return values


def _numbers(values: NDArray[Any], column: str, name: str) -> Floats:
    if np.iscomplexobj(values):
        raise ImportFailed(f"{name}, {column}: complex numbers are none of a sensor")
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError, OverflowError):
        for k, value in enumerate(np.atleast_1d(values)):
            try:
                float(value)
            except (TypeError, ValueError, OverflowError):
                shown = str(value)[:40]
                raise ImportFailed(f"{name}, frame {k}, {column}: {shown!r} is not a number") from None
        raise


def _fill_dead(pressure: Floats, said: Declaration, name: str) -> None:
    """Dead cells become the mean of their live neighbours, step by step; NaN elsewhere is refused."""
    alive = np.ones((said.rows, said.columns), bool)
    for row, column in said.dead:
        alive[row, column] = False
    alive &= ~np.isnan(pressure).all(axis=0)
    bad = np.argwhere(~np.isfinite(pressure) & alive)
    if len(bad):
        k, row, column = bad[0]
        raise ImportFailed(
            f"{name}, frame {k}, cell {row}, {column}: not a number; name the cell as dead if it always is"
        )
    if not alive.any():
        raise ImportFailed(f"{name}: every cell is dead")
    pressure[:, ~alive] = 0.0
    while not alive.all():
        weights, sums = np.zeros(alive.shape), np.zeros_like(pressure)
        for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
            seen = np.roll(alive, step, axis).astype(float)
            edge: list[Any] = [slice(None), slice(None)]
            edge[axis] = 0 if step > 0 else -1
            seen[tuple(edge)] = 0
            weights += seen
            sums += np.roll(pressure, step, axis + 1) * seen
        new = ~alive & (weights > 0)
        pressure[:, new] = sums[:, new] / weights[new]
        alive |= new


class _Arrays:
    """Named arrays, each read when asked for."""

    def __init__(self, names: list[str], load: Callable[[str], NDArray[Any]]) -> None:
        self.names, self._load = names, load

    def get(self, name: str) -> NDArray[Any]:
        """The array of this name."""
        return self._load(name)


def _table(path: Path) -> _Source:
    import pandas as pd

    def load() -> pd.DataFrame:
        if path.suffix.lower() == ".csv":
            sep, decimal = dialect_of(path)
            return pd.read_csv(path, sep=sep, decimal=decimal)
        import pyarrow.parquet as pq

        about = pq.read_metadata(path)
        groups = (about.row_group(k) for k in range(about.num_row_groups))
        size = sum(group.total_byte_size for group in groups)
        _check_size(path, max(size, about.num_rows * about.num_columns))
        return pd.read_parquet(path)

    table = _opened(path, load)
    return _Arrays([str(name) for name in table.columns], lambda name: table[name].to_numpy())


def _npz(path: Path) -> _Source:
    def load() -> Any:
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as packed:
                _check_size(path, sum(member.file_size for member in packed.infolist()))
        return np.load(path, allow_pickle=False)

    found = _opened(path, load)
    if not hasattr(found, "files"):
        raise ImportFailed(f"{path} is not an archive of arrays; write it with numpy.savez")
    return _Arrays(list(found.files), lambda name: found[name])


def _hdf5(path: Path) -> _Source:
    try:
        import h5py
    except ModuleNotFoundError:
        raise MissingExtra("h5py", "hdf5", "reading HDF5") from None

    def load() -> dict[str, Any]:
        found: dict[str, Any] = {}
        with h5py.File(path) as file:
            file.visititems(
                lambda at, item: found.update({at: item.nbytes}) if isinstance(item, h5py.Dataset) else None
            )
        return found

    def get(name: str) -> NDArray[Any]:
        with h5py.File(path) as file:
            item = file[name]
            if item.external or item.is_virtual:
                raise ImportFailed(f"{path.name}, {name}: it lies in another file; put it into this one")
            _check_size(path, item.nbytes)
            return np.asarray(item[()])

    names = list(_opened(path, load))
    if any(name.endswith(LESS) for name in names):
        arrays = published.trajectories(path)
        return _Arrays(list(arrays), arrays.__getitem__)
    return _Arrays(names, get)


def _presses(path: Path) -> _Source:
    arrays = published.presses(path)
    return _Arrays(list(arrays), arrays.__getitem__)


def _check_size(path: Path, size: int) -> None:
    """Refuse what unpacks to more than frames ever do: before it takes all memory."""
    if size > max(LARGEST, EXPANSION * path.stat().st_size):
        raise ImportFailed(
            f"{path.name} unpacks to {size / 1e6:.0f} MB, over {EXPANSION} times its size; frames do not"
        )


def _opened(path: Path, load: Callable[[], Any]) -> Any:
    try:
        check_readable(path, MOST_READ)
        return load()
    except FileNotFoundError:
        raise NoSuchFile(f"there is no file {path}; check the name") from None
    except OSError as error:
        raise NoSuchFile(f"{path} cannot be read: {(error.strerror or _first_line(error)).lower()}") from None
    except UsageError:
        raise
    except Exception as error:  # whatever a damaged file makes of a reader of others
        raise ImportFailed(f"{path} cannot be read: {_first_line(error)}") from None


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]
