"""The result of a field fit: the model, and how well it does on unseen lumps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from rich.table import Table

from palpate.learn.field import tables
from palpate.learn.field.model import Answers, FieldModel
from palpate.learn.field.recipe import FIELD
from palpate.learn.field.score import HeldOutRow, flat
from palpate.learn.observed import ObservedStrokes
from palpate.model_export.schema import ModelSpec

TARGETS_MET = {
    ("none", 1): {"t_r2": 0.999, "d_r2": 0.998, "h_r2": 0.996, "E_inv23_r2": 0.985},
    ("typical", 1): {
        "t_r2": 0.997,
        "t_error": 0.012,
        "d_r2": 0.987,
        "d_error": 0.024,
        "h_r2": 0.98,
        "h_error": 0.03,
        "E_inv23_r2": 0.95,
        "hard_soft": 0.95,
        "hard_soft_far": 0.99,
    },
    ("typical", 4): {"E_inv23_r2": 0.97},
}
"""(noise, strokes) -> what the field recipe should reach on lumps it has not seen."""


@dataclass(frozen=True)
class FieldFit:
    """A field model, and how well it does on unseen lumps.

    Attributes
    ----------
    spec : ModelSpec
        What `palpate fit` writes; trained at `noise`.
    model : FieldModel
    rows : list of HeldOutRow
    coverage : DataFrame
        Of the intervals, by group (`score.coverage`).
    excluded : dict
        Reason -> how many strokes were left out of training, calibration or test.
    facts : dict
        Domain flags, false alarms, hardness, bounds.
    flagged : DataFrame
        The domain flag by distance from the ranges' ends (`flags.by_distance`).
    found : DataFrame
        Detectability by d, h and E.
    visits : DataFrame
        Smallest change of diameter between two visits, %.
    """

    spec: ModelSpec
    model: FieldModel
    noise: str
    rows: list[HeldOutRow]
    coverage: pd.DataFrame
    excluded: dict[str, int]
    facts: dict[str, float]
    flagged: pd.DataFrame
    found: pd.DataFrame
    visits: pd.DataFrame
    test: ObservedStrokes = field(repr=False)
    answers: Answers = field(repr=False)

    def tables(self) -> list[Table]:
        """What `palpate fit --kind field` prints."""
        return [
            tables.held_out(self.rows, self.missed_targets()),
            tables.coverage(self.coverage, self.model.widths.level, self.noise),
            tables.facts(self.facts, self.noise),
            tables.flagged(self.flagged),
            tables.excluded(self.excluded),
            tables.found(self.found),
            tables.visits(self.visits),
        ]

    def missed_targets(self) -> list[str]:
        """Targets not reached, each as a sentence with the number reached."""
        out = []
        for row in self.rows:
            for name, goal in TARGETS_MET.get((row.noise, row.strokes), {}).items():
                got = row.scores[name]
                fine = got <= goal if name.endswith("_error") else got >= goal
                if row.recipe == FIELD.name and not fine:
                    out.append(f"{row.noise}, {row.strokes} stroke(s): {name} is {got:.4f}, wanted {goal}")
        return out

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return {
            "noise": self.noise,
            "held_out": [row.to_dict() for row in self.rows],
            "targets_missed": self.missed_targets(),
            "coverage": self.coverage.reset_index(names="group").to_dict("records"),
            "excluded": self.excluded,
            **flat(self.facts),
            "flagged_by_distance": [_ends(row) for row in self.flagged.to_dict("records")],
            "detectability": self.found.to_dict("records"),
            "two_visits_change_of_diameter_percent": self.visits.to_dict("records"),
            "training": self.spec.training,
        }


def _ends(row: dict[Any, Any]) -> dict[str, Any]:
    """A row with its infinite ends as None, for JSON."""
    return {name: value if np.isfinite(value) else None for name, value in row.items()}
