"""The tables of `palpate study balls`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from palpate.regression.any_tissue.observed import TissueLump
from palpate.regression.any_tissue.study import force_map_of
from palpate.regression.any_tissue.study import text_of as outputs_text
from palpate.regression.balls import limit, study
from palpate.regression.balls.emulator import fit_emulator

LIMITS = 64
"""Lumps that the limit is worked out for, the first ones; each takes a second."""


@dataclass(frozen=True)
class StudyTable:
    """One table: as text (heads and rows), and its numbers."""

    name: str
    title: str
    text: tuple[list[str], list[list[str]]]
    numbers: pd.DataFrame

    def records(self) -> list[dict[str, Any]]:
        """Rows without what is not known."""
        return [{str(k): v for k, v in row.items() if v == v} for row in self.numbers.to_dict("records")]


def tables_of(
    lumps: Sequence[TissueLump],
    noise: str,
    seed: int,
    workers: int = 1,
    step: Callable[[str], None] | None = None,
) -> list[StudyTable]:
    """Kinds of lumps, the images' limit, and learning from ever more lumps."""
    force_map = force_map_of(lumps)
    kinds = study.classes_of(lumps, force_map, noise, seed, workers, step)
    emulator = fit_emulator(lumps)
    # the first ones, since any part of a Sobol sequence but its beginning is no fair sample
    bound = limit.table_of([limit.limit_of(emulator, lump, noise) for lump in lumps[:LIMITS]])
    if step:
        step("limits worked out")
    learnt = study.learning_of(lumps, force_map, noise, seed, step)
    return [
        StudyTable("kinds", f"Balls and ellipsoids, noise {noise}", study.text_of(kinds), kinds),
        StudyTable("limit", "Least median error that the images allow", limit.text_of(bound), bound),
        StudyTable("learning", "Learnt from ever more lumps", outputs_text(learnt, {}), learnt),
    ]
