"""The result of a field fit: the model, and how well it does on unseen lumps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.table import Table

from palpate.learn import tables
from palpate.learn.conformal import LEVEL
from palpate.learn.flags import facts_of
from palpate.learn.model import Answers, FittedModel
from palpate.learn.observed import Observed
from palpate.learn.probe_model import OUTPUTS, training_hash
from palpate.learn.reference import JoiningFit
from palpate.learn.scopes import FIELD
from palpate.learn.score import HeldOutRow, flat
from palpate.learn.study import Study, TextTable, text_of
from palpate.model_export.integers.force_map import ForceMap
from palpate.model_export.schema import FirstStage, ModelSpec

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
    model : FittedModel
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
    model: FittedModel
    noise: str
    rows: list[HeldOutRow]
    coverage: pd.DataFrame
    excluded: dict[str, int]
    facts: dict[str, float]
    flagged: pd.DataFrame
    found: pd.DataFrame
    visits: pd.DataFrame
    test: Observed = field(repr=False)
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


_STRANGE = {
    "flagged": "flagged",
    "d_missed": "d's interval misses",
    "silent_before": "misses, no flag, without the checks",
    "silent": "misses, no flag",
}


@dataclass(frozen=True)
class TissueFit:
    """A model that is not told its tissue, and how well it does.

    Attributes
    ----------
    spec : ModelSpec
        What `palpate fit` writes; trained at `noise`.
    model : FittedModel
    rows : list of dict
        Of the held-out table (`study.Study.row`).
    study : Study
        Held-out estimates at `noise`, with the press.
    strange : DataFrame
        Two lumps side by side, tissue that undulates (`strange.strange_table`).
    facts : dict
        Domain flags, false alarms.
    excluded : dict
        Reason -> how many strokes were left out.
    """

    spec: ModelSpec
    model: FittedModel
    noise: str
    rows: list[dict[str, object]]
    study: Study = field(repr=False)
    strange: pd.DataFrame = field(repr=False)
    facts: dict[str, float] = field(repr=False)
    excluded: dict[str, int] = field(repr=False)

    def coverage(self) -> pd.DataFrame:
        """Share of true values inside the intervals: all, and each quarter of lump and tissue."""
        study = self.study
        inside = np.abs(study.y - study.seen.truth) <= study.half
        groups = {"all": np.ones(len(inside), bool), **study.parts}
        rows = {
            name: {"n": int(group.sum()), **dict(zip(OUTPUTS, inside[group].mean(0)))}
            for name, group in groups.items()
        }
        return pd.DataFrame.from_dict(rows, orient="index")

    def tables(self) -> list[Table]:
        """What `palpate fit --kind field` prints."""
        heads, rows = text_of(pd.DataFrame(self.rows), self.study.targets)
        title = "Lumps and tissue never seen: R2 / median error / % in the interval"
        held_out = tables.shown(title, heads, rows, caption=tables.targets(self.missed_targets()))
        found = self.coverage()
        cells = [
            [str(name), *(f"{100 * row[output]:.0f}" for output in OUTPUTS), f"{row['n']:.0f}"]
            for name, row in found.iterrows()
        ]
        title = f"Coverage of the {100 * LEVEL:.0f} % intervals, %, noise {self.noise}"
        return [
            held_out,
            *(tables.shown(*table) for table in self.study.further_tables()),
            tables.shown(title, ["lumps", *OUTPUTS, "n"], cells),
            tables.facts(self.facts, self.noise),
            tables.shown(
                f"Two lumps, uneven tissue: noise {self.noise}, %",
                ["strokes that find a lump", *_STRANGE.values(), "n"],
                [
                    [row["strokes"], *(f"{100 * row[name]:.1f}" for name in _STRANGE), str(row["n"])]
                    for row in self.strange.to_dict("records")
                ],
            ),
            tables.excluded(self.excluded),
        ]

    def missed_targets(self) -> list[str]:
        """Targets not reached with the press at typical noise, each as a sentence with the number reached."""
        out = []
        for row in self.rows:
            if row["setting"] != "typical, with its press":
                continue
            for name, goal in self.study.targets.items():
                high = name.endswith("_r2") or name in ("hard_soft", "worst_quarter")
                got = float(row[name if high else f"{name}_error"])  # type: ignore[arg-type]
                if got < goal if high else got > goal:
                    out.append(f"{name} is {got:.3f}, wanted {goal}")
        return out

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return {
            "noise": self.noise,
            "held_out": [flat(row) for row in self.rows],
            "targets_missed": self.missed_targets(),
            "coverage": self.coverage().reset_index(names="group").to_dict("records"),
            "excluded": self.excluded,
            **flat(self.facts),
            "strange": self.strange.to_dict("records"),
            **({"tables": records(further)} if (further := self.study.further_tables()) else {}),
            "training": self.spec.training,
        }


def records(tables: Sequence[TextTable]) -> list[dict[str, Any]]:
    """Tables as JSON: `title`, and `rows` by head."""
    return [
        {"title": title, "rows": [dict(zip(heads, row)) for row in rows]} for title, heads, rows in tables
    ]


def tissue_fit(
    model: FittedModel,
    joining: JoiningFit,
    checks: FirstStage,
    fitted_to: Sequence[Observed],
    counts: Mapping[str, int],
    noise: str,
    seed: int,
    study: Study,
    rows: list[dict[str, object]],
    force_map: ForceMap,
    strange: pd.DataFrame,
    outside: Observed | None,
    plain: Observed,
    left_out: dict[str, int],
    **host: Any,
) -> TissueFit:
    """The result, with its document: hash and counts of what the model was fitted to, and its scores.

    counts : what the document says of the lumps; outside, plain : see `flags.facts_of`; host : the parts that
    the host tells (`model.Model.spec`).
    """
    training = {
        "hash": training_hash(*(array for part in fitted_to for array in (part.X, part.truth))),
        "n": sum(int(part.found.sum()) for part in fitted_to),
        **counts,
        "noise": Path(noise).name,
        "seed": seed,
        "tissue": "any",
        **study.training,
    }
    scores = {name: value for name, value in rows[1].items() if isinstance(value, float)}
    whole = replace(model, checks=checks)
    return TissueFit(
        spec=whole.spec(training, force_map.as_dict(), joining.data(), held_out=scores, **host),
        model=model,
        noise=noise,
        rows=rows,
        study=study,
        strange=strange,
        facts=facts_of(model, study.flagged, outside, plain),
        excluded=left_out,
    )
