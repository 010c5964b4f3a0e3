"""Reading what a finished sweep has left behind."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.records import stroke_of
from palpate.sim.tissue.result import Stroke


def check_finished(out_dir: str | Path) -> Path:
    """The file of a finished sweep.

    Raises
    ------
    CaseError
        There is none.
    """
    path = Path(out_dir) / "strokes.parquet"
    if not path.exists():
        unfinished = path.with_name("finished.journal").exists()
        hint = (
            "the sweep in it is unfinished; run it again to go on"
            if unfinished
            else "run a sweep into it first"
        )
        raise CaseError(f"{out_dir} holds no finished sweep; {hint}")
    return path


def read_table(out_dir: str | Path, series: bool = True) -> pd.DataFrame:
    """The table of a finished sweep, with its columns of lists or without these `series`.

    Raises
    ------
    CaseError
        There is none.
    """
    path = check_finished(out_dir)
    plain = [field.name for field in pq.read_schema(path) if not pa.types.is_list(field.type)]
    return pq.read_table(path, columns=None if series else plain).to_pandas()


def load_strokes(out_dir: str | Path) -> list[Stroke]:
    """The strokes of a finished sweep that did not fail, in the design's order."""
    return list(iterate_strokes(out_dir))


def iterate_strokes(out_dir: str | Path) -> Iterator[Stroke]:
    """As `load_strokes`, one after the other, however many there are."""
    read_table(out_dir, series=False)
    with pq.ParquetFile(Path(out_dir) / "strokes.parquet") as table:
        for batch in table.iter_batches(1024):
            for record in batch.to_pylist():
                if record["status"] == "ok":
                    yield stroke_of(record)
