"""Reading a data set: every row is checked, and what is wrong is one sentence with its row and column.

Rows count as in a spreadsheet: the heading is row 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from palpate.dataset.columns import COLUMNS, LIKELY_SLIPS, NEEDED, PLACES, TRUTH, Column, DataSetError
from palpate.errors import NoSuchFile
from palpate.files import by_suffix, whole_file

OF_THE_LUMP = ("d_mm", "depth_mm", "t_mm", "E_ratio")
"""What must be the same in every row of a lump."""


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
    return _opened(path, lambda: pd.read_csv(path, dtype=str, keep_default_na=False, skipinitialspace=True))


def _parquet(path: Path) -> pd.DataFrame:
    return _opened(path, lambda: pd.read_parquet(path))


def _opened(path: Path, load: Callable[[], pd.DataFrame]) -> pd.DataFrame:
    try:
        return load()
    except FileNotFoundError:
        raise NoSuchFile(f"there is no data set {path}; check the name") from None
    except OSError as error:
        raise NoSuchFile(
            f"the data set {path} cannot be read: {(error.strerror or str(error)).lower()}"
        ) from None
    except (ValueError, UnicodeDecodeError) as error:  # pandas' and pyarrow's own errors are ValueErrors
        raise DataSetError(f"{path} cannot be read as a table: {str(error).splitlines()[0]}") from None


def check(raw: pd.DataFrame, path: Path) -> DataSet:
    """The same of a table in memory; recordings are looked for beside `path`."""
    missing = [column.name for column in NEEDED if column.name not in raw]
    if missing:
        raise DataSetError(f"{path} has no column {missing[0]}: {COLUMNS[missing[0]].says}")
    if not any(column.name in raw for column in TRUTH):
        raise DataSetError(f"{path} has no truth: it needs one of {', '.join(c.name for c in TRUTH)}")
    if raw.empty:
        raise DataSetError(f"{path} has no rows")
    out = pd.DataFrame({"row": np.arange(2, len(raw) + 2)})
    for name, column in COLUMNS.items():
        values = raw[name] if name in raw else [""] * len(raw)
        out[name] = _numbers(values, column) if column.number else [_text(v) for v in values]
    _words(out)
    _truth(out)
    out["recording"] = [path.parent / name for name in out["recording"]]
    _no_stroke_twice(out)
    _one_truth_a_lump(out)
    return DataSet(path, out, tuple(_remarks(out)))


def fault(row: Any, column: str, what: str) -> DataSetError:
    """The sentence for what is wrong in one place."""
    return DataSetError(f"row {int(row)}, column {column}: {what}")


def _text(value: Any) -> str:
    return "" if value is None or value is pd.NaT or value != value else str(value).strip()


def _numbers(values: Iterable[Any], column: Column) -> list[float]:
    out = []
    needed = column in NEEDED
    for k, value in enumerate(values):
        text = _text(value)
        if not text and needed:
            raise fault(k + 2, column.name, "it is empty")
        if not text and isinstance(value, str):
            out.append(math.nan)
            continue
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise fault(k + 2, column.name, f"{text!r} is not a number") from None
        if not math.isfinite(number):
            if isinstance(value, str) or needed:  # Parquet's NaN is an empty place
                raise fault(k + 2, column.name, f"{text} is not a number; leave empty what is not known")
        elif not column.low <= number <= column.high:
            slip = slip_of(column.name, number, column.low, column.high)
            raise fault(
                k + 2, column.name, f"{number:g} is not within {column.low:g} to {column.high:g}{slip}"
            )
        out.append(number)
    return out


def slip_of(name: str, value: float, low: float, high: float) -> str:
    """What unit a value seems to be in, as the end of a sentence; "" if none would bring it into range."""
    for factor, unit in LIKELY_SLIPS.get(name, ()):
        if low <= value * factor <= high:
            return f"; is it in {unit}? {name} is in mm, and {value * factor:g} would do"
    if name == "E_ratio":
        return "; E_ratio is a multiple of the fat's stiffness, kPa go into E_kPa"
    return ""


def _words(out: pd.DataFrame) -> None:
    for column in NEEDED:
        if not column.number:
            for row, value in zip(out["row"], out[column.name]):
                if not value:
                    raise fault(row, column.name, "it is empty")
    for row, place in zip(out["row"], out["place"]):
        if place not in PLACES:
            raise fault(row, "place", f"{place!r} is not one of border, fat, gland")
    for row, when in zip(out["row"], out["when"]):
        if when and pd.isna(pd.to_datetime(when, errors="coerce")):
            raise fault(row, "when", f"{when!r} is not a date; write it as 2026-11-21")
    for row, stroke in zip(out["row"], out["stroke"]):
        if stroke != int(stroke):
            raise fault(row, "stroke", f"{stroke:g} is not a whole number")
    out["stroke"] = out["stroke"].astype(int)


def _truth(out: pd.DataFrame) -> None:
    """Work out what one column tells of another; two that contradict each other are refused."""
    for row, E_kPa, fat_kPa in zip(out["row"], out["E_kPa"], out["fat_kPa"]):
        if E_kPa == E_kPa and fat_kPa != fat_kPa:
            raise fault(
                row, "E_kPa", "it needs fat_kPa, for the model knows stiffness as a multiple of fat's"
            )
    _derive(out, "depth_mm", out["h"] * out["d_mm"], "h")
    _derive(out, "h", out["depth_mm"] / out["d_mm"], "depth_mm")
    _derive(out, "E_ratio", out["E_kPa"] / out["fat_kPa"], "E_kPa")
    tied = (out["depth_mm"] + out["d_mm"] / 2).where(out["place"] == "border")
    _derive(out, "t_mm", tied, "depth_mm")
    nothing = out[["d_mm", "depth_mm", "t_mm", "E_ratio"]].isna().all(axis=1)
    if nothing.any():
        raise fault(out.loc[nothing, "row"].iloc[0], "d_mm", "the row holds no truth at all")


def _derive(out: pd.DataFrame, name: str, other: pd.Series, source: str) -> None:
    known, told = out[name].notna(), other.notna()
    differs = known & told & ((out[name] - other).abs() > 0.03 * other.abs())
    if differs.any():
        k = int(np.flatnonzero(differs)[0])
        raise fault(
            out["row"].iloc[k],
            name,
            f"{out[name].iloc[k]:g} contradicts {source}, which makes it {other.iloc[k]:.3g}",
        )
    out[name] = out[name].where(known, other)


def _no_stroke_twice(out: pd.DataFrame) -> None:
    seen: dict[tuple[Path, int], int] = {}
    for row, recording, stroke in zip(out["row"], out["recording"], out["stroke"]):
        first = seen.setdefault((recording.resolve(), stroke), row)
        if first != row:
            raise fault(
                row,
                "stroke",
                f"stroke {stroke} of {recording.name} is listed twice; it is in row {first} too",
            )


def _one_truth_a_lump(out: pd.DataFrame) -> None:
    first: Mapping[str, pd.Series] = {}
    known: dict[str, pd.Series] = dict(first)
    for _, line in out.iterrows():
        other = known.setdefault(line["lump"], line)
        for name in OF_THE_LUMP:
            a, b = other[name], line[name]
            if (a != b and not (a != a and b != b)) or (a == a) != (b == b):
                raise fault(
                    line["row"],
                    name,
                    f"lump {line['lump']} has {b:g} here and {a:g} in row {other['row']}; give another lump "
                    "another name",
                )


def _remarks(out: pd.DataFrame) -> Iterable[str]:
    count = out.groupby("lump", sort=False)["row"].agg(["size", "first"])
    single = count[count["size"] == 1]
    if len(single):
        row, lump = int(single["first"].iloc[0]), single.index[0]
        more = f" and {len(single) - 1} more" if len(single) > 1 else ""
        yield (
            f"row {row}, column lump: {lump}{more} has one stroke only, which tells nothing of how strokes "
            "repeat"
        )
    if (untied := out["t_mm"].isna() & out["depth_mm"].notna()).any():
        row = int(out.loc[untied, "row"].iloc[0])
        yield (
            f"row {row}, column t_mm: it is empty and place does not say border, so the fat's thickness is "
            "not judged there"
        )
