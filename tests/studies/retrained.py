"""Studies that retrain the told model for each setting, and score it on the same held-out lumps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from palpate.learn.conformal import LEVEL
from palpate.learn.data import Strokes, read_strokes
from palpate.learn.lumps import LumpStrokes
from palpate.learn.model import FittedModel, learn_force_map
from palpate.learn.observed import Observed, joined, noise_named, observe
from palpate.learn.study import Study as Estimates
from palpate.model_export.integers import force_map as force_maps
from palpate.progress import ProgressCallback
from palpate.sim.probe.sensors import LEVELS, Noise
from tests.studies.table import Asked, StudyTable

DRAWS = 2
TESTED = 3
"""Every third lump is not trained on."""
Tell = Callable[[str], None]
Row = dict[str, Any]


@dataclass(frozen=True)
class Bench:
    """Strokes over lumps in one tissue, which any sensors feel.

    noise: the sensors of a study, but for what it varies
    """

    strokes: Strokes
    seed: int = 1
    directory: Path = Path()
    noise: Noise = LEVELS["typical"]
    progress: ProgressCallback | None = None

    @property
    def train(self) -> list[LumpStrokes]:
        """Lumps to train on."""
        return [lump for k, lump in enumerate(self.strokes.lumps) if k % TESTED]

    @property
    def test(self) -> list[LumpStrokes]:
        """The others."""
        return self.strokes.lumps[::TESTED]

    @cached_property
    def blob(self) -> bytes:
        """The force map of the lumps to train on."""
        return force_maps.blob(learn_force_map(self.train))

    def felt(self, lumps: list[LumpStrokes], noise: Noise, draw: int, **sensor: Any) -> Observed:
        """`DRAWS` strokes over each lump; sensor: options of `observed.observe`."""
        fields, sensor = [lump.field for lump in lumps], {"force_map": self.blob} | sensor
        seeds = range(1000 * self.seed + draw, 1000 * self.seed + draw + DRAWS)
        return joined([observe(fields, noise, seed, **sensor) for seed in seeds])

    def parts(self, noise: Noise, **sensor: Any) -> tuple[Observed, Observed, Observed]:
        """Strokes over lumps to train on, the rim and the lumps to test on."""
        parts = (self.train, self.strokes.rim, self.test)
        train, rim, test = (self.felt(of, noise, 100 * k, **sensor) for k, of in enumerate(parts))
        return train, rim, test


@dataclass(frozen=True)
class Study:
    """One study: its name on the command line, a heading, what the settings are, and how to run it."""

    name: str
    title: str
    setting: str
    run: Callable[[Bench], Iterator[Row]]

    def of_directory(self, asked: Asked) -> pd.DataFrame:
        """The study of the strokes in a directory of `palpate fit --kind field --tissue thesis`."""
        noise = noise_named(asked.noise or "typical")
        strokes = read_strokes(asked.directory)
        return self.table(Bench(strokes, asked.seed, asked.directory, noise, asked.progress), asked.tell)

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
            f"d +-{100 * LEVEL:g}": lambda r: f"{100 * r.d_half:.1f}",
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
                "d covered": lambda r: f"{100 * r.d_covered:.0f}",
                "flagged": lambda r: f"{100 * r.flagged:.0f}",
                "d missed, no flag": lambda r: f"{100 * r.silent:.0f}",
            }
        rows = [[str(r.setting), *(show(r) for show in columns.values())] for r in result.itertuples()]
        return StudyTable(self.title, [self.setting, *columns], rows, result)


def row_of(setting: str, model: FittedModel, test: Observed) -> tuple[Row, Estimates]:
    """Scores of one setting, and what the model says of the lumps that it finds."""
    study = Estimates.of(model, test)
    return study.row(setting), study
