"""What a study is asked, and what it answers: tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from palpate.progress import ProgressCallback


@dataclass(frozen=True)
class Asked:
    """Where strokes lie or are simulated, how many lumps, the noise's seed and level (None: the study's own).

    `tell` is told a line for each setting that was tried.
    """

    directory: Path
    lumps: int | None = None
    seed: int = 1
    noise: str | None = None
    progress: ProgressCallback | None = None
    tell: Callable[[str], None] = lambda line: None


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


def of_text(title: str, heads: list[str], rows: list[list[str]]) -> StudyTable:
    """A table whose numbers are its text."""
    return StudyTable(title, heads, rows, pd.DataFrame(rows, columns=heads))
