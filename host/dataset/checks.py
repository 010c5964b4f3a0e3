"""The checks of a data set, row by row; every failure is a sentence with row and column."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from palpate.dataset.columns import LIKELY_SLIPS, NEEDED, PLACES, Column, DataSetError

OF_THE_LUMP = ("d_mm", "depth_mm", "t_mm", "E_ratio")
"""What must be the same in every row of a lump."""


def fault(row: Any, column: str, what: str) -> DataSetError:
    """The sentence for what is wrong in one place."""
    return DataSetError(f"row {int(row)}, column {column}: {what}")


def text_of(value: Any) -> str:
    """A place of the table as text; "" where it is empty."""
    empty = value is None or value is pd.NaT or value is pd.NA or (np.isscalar(value) and value != value)
    return "" if empty else str(value).strip()


def numbers(values: Iterable[Any], column: Column, rows: Iterable[int]) -> list[float]:
    """A column as numbers, NaN where it is empty; `rows` are the numbers of its rows, for what is wrong."""
    out = []
    needed = column in NEEDED
    for row, value in zip(rows, values, strict=True):
        text = text_of(value)
        if not text and needed:
            raise fault(row, column.name, "it is empty")
        if not text and isinstance(value, str):
            out.append(math.nan)
            continue
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise fault(row, column.name, f"{text!r} is not a number") from None
        if not math.isfinite(number):
            if isinstance(value, str) or needed:  # Parquet's NaN is an empty place
                raise fault(row, column.name, f"{text} is not a number; leave empty what is not known")
        elif not column.low <= number <= column.high:
            slip = slip_of(column.name, number, column.low, column.high)
            raise fault(row, column.name, f"{number:g} is not within {column.low:g} to {column.high:g}{slip}")
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


def check_words(out: pd.DataFrame) -> None:
    """Names, places and dates; stroke numbers become integers."""
    for column in NEEDED:
        if not column.number:
            for row, value in zip(out["row"], out[column.name]):
                if not value:
                    raise fault(row, column.name, "it is empty")
    for row, name in zip(out["row"], out["recording"]):
        if "\0" in name:
            raise fault(row, "recording", f"{name!r} is no file's name")
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


def work_out_truth(out: pd.DataFrame) -> None:
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


def no_stroke_twice(out: pd.DataFrame) -> None:
    """No stroke of a recording is listed twice."""
    seen: dict[tuple[Path, int], int] = {}
    for row, recording, stroke in zip(out["row"], out["recording"], out["stroke"]):
        first = seen.setdefault((recording.resolve(), stroke), row)
        if first != row:
            raise fault(
                row,
                "stroke",
                f"stroke {stroke} of {recording.name} is listed twice; it is in row {first} too",
            )


def one_truth_a_lump(out: pd.DataFrame) -> None:
    """All rows of a lump say the same of it."""
    known: dict[str, pd.Series] = {}
    for _, line in out.iterrows():
        other = known.setdefault(line["lump"], line)
        for name in OF_THE_LUMP:
            there, here = ("nothing" if math.isnan(v) else f"{v:g}" for v in (other[name], line[name]))
            if there != here:
                what = f"lump {line['lump']} has {here} here and {there} in row {other['row']}"
                raise fault(line["row"], name, f"{what}; give another lump another name")


def remarks(out: pd.DataFrame) -> Iterable[str]:
    """What is not wrong, and still should be known."""
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
