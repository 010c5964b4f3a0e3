"""What a study is asked, and what it answers: tables."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from palpate.errors import UsageError
from palpate.progress import ProgressCallback


@dataclass(frozen=True)
class Asked:
    """Where strokes lie or are simulated, how many lumps, the noise's seed and level (None: the study's own).

    The first `after` lumps are left out. `tell` is told a line for each setting that was tried.
    """

    directory: Path
    lumps: int | None = None
    seed: int = 1
    noise: str | None = None
    progress: ProgressCallback | None = None
    tell: Callable[[str], None] = lambda line: None
    after: int = 0


@dataclass(frozen=True)
class StudyTable:
    """A title, heads and rows of text; `numbers` are what they were made of."""

    title: str
    heads: list[str]
    rows: list[list[str]]
    numbers: pd.DataFrame

    def to_dict(self) -> dict[str, Any]:
        """For JSON: rows without what is not known."""
        known = [{str(k): v for k, v in row.items() if v == v} for row in self.numbers.to_dict("records")]
        return {"title": self.title, "rows": known}


def kept_rows(
    asked: Asked, name: str, count: int, row_of: Callable[[int], dict[str, Any]]
) -> list[dict[str, Any]]:
    """A row for each lump, worked out where DIRECTORY/`name` (JSON, a line each) does not hold it yet."""
    if asked.after >= count:
        raise UsageError(f"--after {asked.after} leaves none of the {count} lumps")
    kept = asked.directory / name
    asked.directory.mkdir(parents=True, exist_ok=True)
    lines = kept.read_text().splitlines() if kept.exists() else []
    done = {(row["seed"], row["lump"]): row for row in map(json.loads, lines)}
    for k in range(asked.after, count):
        if (asked.seed, k) not in done:
            row = {"seed": asked.seed, "lump": k, **row_of(k)}
            with kept.open("a") as out:
                out.write(json.dumps(row) + "\n")
            done[asked.seed, k] = row
            asked.tell(f"{k + 1} of {count}: {row['code']}")
    return [row for (seed, lump), row in done.items() if seed == asked.seed and lump >= asked.after]


def of_text(title: str, heads: list[str], rows: list[list[str]]) -> StudyTable:
    """A table whose numbers are its text."""
    return StudyTable(title, heads, rows, pd.DataFrame(rows, columns=heads))
