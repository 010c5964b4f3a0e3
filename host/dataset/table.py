"""Reading a data set: every row is checked, and what is wrong is one sentence with its row and column.

Rows count as in a spreadsheet: the heading is row 1.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from palpate.csv_dialect import COMMA_NUMBER, dialect_of
from palpate.dataset import checks
from palpate.dataset.columns import COLUMNS, NEEDED, TRUTH, DataSetError
from palpate.errors import NoSuchFile
from palpate.files import by_suffix, check_readable, whole_file

LARGEST = 1 << 28
"""Bytes of a table: a million strokes have fewer."""
MOST_COLUMNS = 10_000


@dataclass(frozen=True)
class DataSet:
    """A data set that has been read.

    Attributes
    ----------
    path : Path
    table : DataFrame
        One row a stroke: `row` (as in the file), `recording` (Path), `stroke`, `lump`, the truth in numbers
        (NaN where it is not known; `h`, `depth_mm`, `t_mm`, `E_ratio` worked out where the others tell
        them), and the words.
    remarks : tuple of str
        What is not wrong, and still should be known.
    """

    path: Path
    table: pd.DataFrame
    remarks: tuple[str, ...] = field(default=())

    def __len__(self) -> int:
        return len(self.table)

    @property
    def lumps(self) -> int:
        """How many lumps there are."""
        return int(self.table["lump"].nunique())

    def only(self, keep: Any, remark: str = "") -> DataSet:
        """Some of the rows (a mask), with a remark more."""
        more = (remark,) if remark else ()
        return replace(self, table=self.table[keep].reset_index(drop=True), remarks=(*self.remarks, *more))


def read(path: str | Path) -> DataSet:
    """Read and check a data set.

    Parameters
    ----------
    path : path
        Ends in .csv or .parquet; its columns are those of `columns.COLUMNS`, others are left alone.

    Raises
    ------
    NoSuchFile, UnknownFormat
        The file itself.
    DataSetError
        What it holds; one sentence with row and column.
    """
    path = Path(path)
    load: Callable[[Path], pd.DataFrame] = by_suffix(path, {".csv": _csv, ".parquet": _parquet})
    return check(load(path), path)


def write(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table of a data set, by the file's suffix."""
    path = Path(path)
    writers = {
        ".csv": lambda part: table.to_csv(part, index=False),
        ".parquet": lambda part: table.to_parquet(part, index=False),
    }
    put: Callable[[Path], None] = by_suffix(path, writers)
    with whole_file(path) as part:
        put(part)


def _csv(path: Path) -> pd.DataFrame:
    raw = _opened(path, lambda: _as_text(path)).fillna("")
    raw = raw[(raw != "").any(axis=1)]  # blank lines count as rows, and hold no stroke
    if raw.empty:
        raise DataSetError(f"{path} cannot be read as a table: it is empty")
    heads = [str(name).removeprefix("\ufeff").strip() for name in raw.iloc[0]]
    for name, times in Counter(heads).items():
        if name and times > 1:
            raise DataSetError(f"row 1, column {name}: it is there twice")
    table = raw.iloc[1:].set_axis(heads, axis=1)
    return table.set_axis(table.index - 1, axis=0)


def _as_text(path: Path) -> pd.DataFrame:
    sep, decimal = dialect_of(path)
    with path.open("rb") as file:
        columns = 1 + file.readline(1 << 20).count(sep.encode())
    if columns > MOST_COLUMNS:
        raise DataSetError(f"{path}: it has {columns} columns, and {MOST_COLUMNS} are read at most")
    raw = pd.read_csv(
        path,
        sep=sep,
        header=None,
        dtype=str,
        keep_default_na=False,
        skipinitialspace=True,
        skip_blank_lines=False,
    )
    return raw.map(_with_a_point) if decimal == "," else raw


def _with_a_point(field: str) -> str:
    return field.replace(",", ".") if COMMA_NUMBER.fullmatch(field) else field


def _parquet(path: Path) -> pd.DataFrame:
    return _opened(path, lambda: pd.read_parquet(path)).reset_index(drop=True)


def _opened(path: Path, load: Callable[[], pd.DataFrame]) -> pd.DataFrame:
    try:
        check_readable(path, LARGEST)
        return load()
    except FileNotFoundError:
        raise NoSuchFile(f"there is no data set {path}; check the name") from None
    except OSError as error:
        raise NoSuchFile(
            f"the data set {path} cannot be read: {(error.strerror or str(error)).lower()}"
        ) from None
    except (ValueError, UnicodeDecodeError) as error:  # pandas' and pyarrow's own errors are ValueErrors
        why = str(error).splitlines()[0].removeprefix("Error tokenizing data. C error: ").split(". ")[0]
        raise DataSetError(f"{path} cannot be read as a table: {why}") from None


def check(raw: pd.DataFrame, path: Path) -> DataSet:
    """The same of a table in memory, whose index begins at 0; recordings are looked for beside `path`."""
    missing = [column.name for column in NEEDED if column.name not in raw]
    if missing:
        raise DataSetError(f"{path} has no column {missing[0]}: {COLUMNS[missing[0]].says}")
    if not any(column.name in raw for column in TRUTH):
        raise DataSetError(f"{path} has no truth: it needs one of {', '.join(c.name for c in TRUTH)}")
    if raw.empty:
        raise DataSetError(f"{path} has no rows")
    out = pd.DataFrame({"row": raw.index.to_numpy() + 2})
    raw = raw.reset_index(drop=True)
    for name, column in COLUMNS.items():
        values = raw[name] if name in raw else [""] * len(raw)
        out[name] = (
            checks.numbers(values, column, out["row"])
            if column.number
            else [checks.text_of(v) for v in values]
        )
    checks.check_words(out)
    checks.work_out_truth(out)
    out["recording"] = [path.parent / name for name in out["recording"]]
    checks.no_stroke_twice(out)
    checks.one_truth_a_lump(out)
    return DataSet(path, out, tuple(checks.remarks(out)))
