"""Studies that retrain the told model for each setting, and score it on the same held-out lumps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from palpate.learn.bench import Bench
from palpate.learn.conformal import LEVEL
from palpate.learn.data import pressed, read
from palpate.learn.model import Answers, FittedModel
from palpate.learn.observed import Observed, noise_named
from palpate.learn.score import hardness, scores
from palpate.learn.table import TARGETS
from tests.studies.table import Asked, StudyTable

DRAWS = (2, 1, 2)
Tell = Callable[[str], None]
Row = dict[str, Any]


@dataclass(frozen=True)
class Study:
    """One study: its name on the command line, a heading, what the settings are, and how to run it."""

    name: str
    title: str
    setting: str
    run: Callable[[Bench], Iterator[Row]]
    with_presses: bool = False
    """Whether the model is to notice other tissues by its press, which is then simulated if need be."""

    def of_directory(self, asked: Asked) -> pd.DataFrame:
        """The study of the strokes in a directory of `palpate fit --kind field --tissue thesis`."""
        noise = noise_named(asked.noise or "typical")
        strokes = read(asked.directory)
        if self.with_presses:
            strokes = pressed(strokes, asked.directory, progress=asked.progress)
        with Bench(strokes, asked.seed, asked.directory, progress=asked.progress, noise=noise) as bench:
            return self.table(bench, asked.tell)

    def table(self, bench: Bench, tell: Tell | None = None) -> pd.DataFrame:
        """One row a setting: R2, median errors, half-widths of the intervals, hard/soft."""
        rows = []
        for row in self.run(bench):
            if tell:
                tell(f"{self.name}: {row['setting']}")
            rows.append(row)
        return pd.DataFrame(rows)

    def shown(self, result: pd.DataFrame) -> StudyTable:
        """R2 and median errors in %, half-width of d's interval in %."""
        columns: dict[str, Callable[[Any], str]] = {
            "t R2": lambda r: f"{r.t_r2:.3f}",
            "t err": lambda r: f"{100 * r.t_error:.1f}",
            "d R2": lambda r: f"{r.d_r2:.3f}",
            "d err": lambda r: f"{100 * r.d_error:.1f}",
            f"d +-{100 * LEVEL:g}": lambda r: f"{100 * r.d_half:.1f}" if r.d_half == r.d_half else "",
            "h R2": lambda r: f"{r.h_r2:.3f}",
            "h err": lambda r: f"{100 * r.h_error:.1f}",
            "E^-2/3 R2": lambda r: f"{r.E_inv23_r2:.3f}",
            "hard/soft": lambda r: f"{100 * r.hard_soft:.1f}",
            "not found": lambda r: f"{100 * r.not_found:.1f}",
        }
        if "d_bias" in result:
            columns |= {
                "t bias": lambda r: f"{100 * r.t_bias:+.1f}",
                "d bias": lambda r: f"{100 * r.d_bias:+.1f}",
                "h bias": lambda r: f"{100 * r.h_bias:+.1f}",
                "d covered": lambda r: f"{100 * r.covered_d:.0f}",
                "flagged": lambda r: f"{100 * r.flagged:.0f}",
                "d missed, no flag": lambda r: f"{100 * r.silent:.0f}",
            }
        rows = [[str(r.setting), *(show(r) for show in columns.values())] for r in result.itertuples()]
        return StudyTable(self.title, [self.setting, *columns], rows, result)


def row_of(setting: str, model: FittedModel, test: Observed, answers: Answers | None = None) -> Row:
    """Scores of one setting, with the median half-width of the intervals and what is not found."""
    answers = model.answer(test) if answers is None else answers
    found = answers.found
    half = np.median(answers.half[found], axis=0)
    out: Row = {"setting": setting, **scores(test, answers.value, found, model.border)}
    out |= {f"{t}_half": float(h) for t, h in zip(TARGETS, half)}
    return out | {"not_found": float((~found).mean()), "decided": hardness(test, answers, found)["decided"]}
