"""The result of a fit: the model, and how well it does on unseen lumps."""

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
from palpate.learn.model import FittedModel
from palpate.learn.observed import Observed
from palpate.learn.probe_model import OUTPUTS, training_hash
from palpate.learn.reference import JoiningFit
from palpate.learn.score import flat, found_by
from palpate.learn.study import Study, TextTable, text_of
from palpate.model_export.integers.force_map import ForceMap
from palpate.model_export.schema import FirstStage, ModelSpec

_STRANGE = {
    "flagged": "flagged",
    "d_missed": "d's interval misses",
    "silent_before": "misses, no flag, without the checks",
    "silent": "misses, no flag",
}


@dataclass(frozen=True)
class TissueFit:
    """A model, and how well it does on lumps that it has not seen.

    Attributes
    ----------
    spec : ModelSpec
        What `palpate fit` writes; trained at `noise`.
    model : FittedModel
    rows : list of dict
        Of the held-out table (`study.Study.row`).
    study : Study
        Held-out estimates at `noise`, with the press where the model takes one.
    strange : DataFrame
        Two lumps side by side, tissue that undulates (`strange.strange_table`).
    facts : dict
        Domain flags, false alarms.
    found : DataFrame
        Detectability by d, depth and E (`score.found_by`).
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
    found: pd.DataFrame = field(repr=False)
    excluded: dict[str, int] = field(repr=False)

    @property
    def outputs(self) -> tuple[str, ...]:
        """What it estimates, of `probe_model.OUTPUTS`."""
        return OUTPUTS[: self.study.scope.estimated]

    def coverage(self) -> pd.DataFrame:
        """Share of true values inside the intervals: all, and each quarter of lump and tissue."""
        study = self.study
        inside = np.abs(study.y - study.seen.truth[:, : study.scope.estimated]) <= study.half
        groups = {"all": np.ones(len(inside), bool), **study.parts}
        rows = {
            name: {"n": int(group.sum()), **dict(zip(self.outputs, inside[group].mean(0)))}
            for name, group in groups.items()
        }
        return pd.DataFrame.from_dict(rows, orient="index")

    def tables(self) -> list[Table]:
        """What `palpate fit --kind field` prints."""
        heads, rows = text_of(pd.DataFrame(self.rows), self.study.scope.targets)
        title = "Lumps never seen: R2 / median error / % in the interval"
        held_out = tables.shown(title, heads, rows, caption=tables.targets(self.missed_targets()))
        found = self.coverage()
        cells = [
            [str(name), *(f"{100 * row[output]:.0f}" for output in self.outputs), f"{row['n']:.0f}"]
            for name, row in found.iterrows()
        ]
        title = f"Coverage of the {100 * LEVEL:.0f} % intervals, %, noise {self.noise}"
        return [
            held_out,
            *(tables.shown(*table) for table in self.study.further_tables()),
            tables.shown(title, ["lumps", *self.outputs, "n"], cells),
            tables.facts(self.facts, self.noise),
            tables.shown(
                f"Two lumps, uneven tissue: noise {self.noise}, %",
                ["strokes that find a lump", *_STRANGE.values(), "n"],
                [
                    [row["strokes"], *(_percent(row[name]) for name in _STRANGE), str(row["n"])]
                    for row in self.strange.to_dict("records")
                ],
            ),
            tables.found(self.found),
            tables.excluded(self.excluded),
        ]

    def missed_targets(self) -> list[str]:
        """Targets not reached at typical noise, each as a sentence with the number reached."""
        out = []
        for row in self.rows:
            if row["setting"] != f"typical, {self.study.scope.input}":
                continue
            for name, goal in self.study.scope.targets.items():
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
            "strange": [flat({str(k): v for k, v in row.items()}) for row in self.strange.to_dict("records")],
            "detectability": self.found.to_dict("records"),
            **({"tables": records(further)} if (further := self.study.further_tables()) else {}),
            "training": self.spec.training,
        }


def _percent(share: float) -> str:
    return "" if np.isnan(share) else f"{100 * share:.1f}"


def records(tables: Sequence[TextTable]) -> list[dict[str, Any]]:
    """Tables as JSON: `title`, and `rows` by head."""
    return [
        {"title": title, "rows": [dict(zip(heads, row)) for row in rows]} for title, heads, rows in tables
    ]


@dataclass(frozen=True)
class Taught:
    """What a model was fitted to.

    counts: what the document says of the lumps; noise: a level, or a sensor's file; seed: of its noise.
    """

    parts: Sequence[Observed]
    counts: Mapping[str, int]
    noise: str
    seed: int
    force_map: ForceMap

    def document(self, words: Mapping[str, str]) -> dict[str, Any]:
        """For the model's document: hash and counts."""
        return {
            "hash": training_hash(*(array for part in self.parts for array in (part.X, part.truth))),
            "n": sum(int(part.found.sum()) for part in self.parts),
            **self.counts,
            "noise": Path(self.noise).name,
            "seed": self.seed,
            **words,
        }


@dataclass(frozen=True)
class Judged:
    """How a model, and others fitted as it was, did on what they had not met; as in `TissueFit`.

    asked: strokes over lumps inside the ranges, found or not; outside, plain: see `flags.facts_of`.
    """

    study: Study
    rows: list[dict[str, object]]
    strange: pd.DataFrame
    asked: Observed
    outside: Observed | None
    plain: Observed
    excluded: dict[str, int]


def tissue_fit(
    model: FittedModel,
    checks: FirstStage,
    joining: JoiningFit | None,
    taught: Taught,
    judged: Judged,
    **host: Any,
) -> TissueFit:
    """The result, with its document.

    checks : what the model notices beside its domain; `facts` are of the domain alone.
    joining : of a model with a first stage.
    host : the parts that the host tells (`model.Model.spec`).
    """
    study, rows = judged.study, judged.rows
    main = next(row for row in rows if row["setting"] == f"{taught.noise}, {study.scope.input}")
    scores = {name: value for name, value in main.items() if isinstance(value, float)}
    training, force_map = taught.document(study.scope.words), taught.force_map.as_dict()
    return TissueFit(
        spec=replace(model, checks=checks).spec(
            training, force_map, joining.data() if joining else None, held_out=scores, **host
        ),
        model=model,
        noise=taught.noise,
        rows=rows,
        study=study,
        strange=judged.strange,
        facts=facts_of(model, study.flagged, judged.outside, judged.plain),
        found=found_by(judged.asked),
        excluded=judged.excluded,
    )
