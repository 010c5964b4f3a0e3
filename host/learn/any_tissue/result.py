"""The result of a fit in any tissue: the model, and how well it does on lumps that it never saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from rich.table import Table

from palpate.learn.any_tissue.model import OUTPUTS, TissueModel, truth
from palpate.learn.any_tissue.study import TARGETS, TextTable, TissueStudy, text_of
from palpate.learn.conformal import LEVEL
from palpate.learn.field.score import flat
from palpate.learn.field.tables import excluded
from palpate.model_export.schema import ModelSpec

_WORDS = {
    "flagged_inside": "lumps inside the ranges flagged as out of domain",
    "flagged_outside": "lumps outside them flagged, of those found",
    "flagged_well_outside": "lumps well outside (5 % or more beyond an end) flagged, of those found",
    "outside_no_lump": "lumps outside not found",
    "false_alarms": "plain tissue taken for a lump",
    "false_alarms_not_flagged": "plain tissue taken for a lump, and not flagged",
}
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
    model : TissueModel
    rows : list of dict
        Of the held-out table (`study.TissueStudy.row`).
    study : TissueStudy
        Held-out estimates at `noise`, with the press.
    strange : DataFrame
        Two lumps side by side, tissue that undulates (`strange.strange_table`).
    facts : dict
        Domain flags, false alarms.
    excluded : dict
        Reason -> how many strokes were left out.
    targets : mapping
        Of median errors, R2 and shares, by their names in `rows`.
    """

    spec: ModelSpec
    model: TissueModel
    noise: str
    rows: list[dict[str, object]]
    study: TissueStudy = field(repr=False)
    strange: pd.DataFrame = field(repr=False)
    facts: dict[str, float] = field(repr=False)
    excluded: dict[str, int] = field(repr=False)
    targets: Mapping[str, float] = field(default_factory=lambda: TARGETS, repr=False)

    def coverage(self) -> pd.DataFrame:
        """Share of true values inside the intervals: all, and each quarter of lump and tissue."""
        Y = truth(self.study.seen)
        inside = np.abs(self.study.y - Y) <= self.study.half
        groups = {"all": np.ones(len(Y), bool), **self.study.parts}
        rows = {
            name: {"n": int(group.sum()), **dict(zip(OUTPUTS, inside[group].mean(0)))}
            for name, group in groups.items()
        }
        return pd.DataFrame.from_dict(rows, orient="index")

    def tables(self) -> list[Table]:
        """What `palpate fit --kind field` prints."""
        heads, rows = text_of(pd.DataFrame(self.rows), self.targets)
        held_out = _table("Lumps and tissue never seen: R2 / median error / % in the interval", heads, rows)
        missed = self.missed_targets()
        held_out.caption = "all targets met" if not missed else "missed: " + "; ".join(missed)
        found = self.coverage()
        cells = [
            [str(name), *(f"{100 * row[output]:.0f}" for output in OUTPUTS), f"{row['n']:.0f}"]
            for name, row in found.iterrows()
        ]
        title = f"Coverage of the {100 * LEVEL:.0f} % intervals, %, noise {self.noise}"
        shares = [
            [words, f"{100 * self.facts[name]:.1f} %"] for name, words in _WORDS.items() if name in self.facts
        ]
        return [
            held_out,
            *(_table(*table) for table in self.study.further_tables()),
            _table(title, ["lumps", *OUTPUTS, "n"], cells),
            _table(f"Flags, noise {self.noise}", ["", "share"], shares),
            _table(
                f"Two lumps, uneven tissue: noise {self.noise}, %",
                ["strokes that find a lump", *_STRANGE.values(), "n"],
                [
                    [row["strokes"], *(f"{100 * row[name]:.1f}" for name in _STRANGE), str(row["n"])]
                    for row in self.strange.to_dict("records")
                ],
            ),
            excluded(self.excluded),
        ]

    def missed_targets(self) -> list[str]:
        """Targets not reached with the press at typical noise, each as a sentence with the number reached."""
        out = []
        for row in self.rows:
            if row["setting"] != "typical, with its press":
                continue
            for name, goal in self.targets.items():
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


def _table(title: str, heads: list[str], rows: list[list[str]]) -> Table:
    out = Table(title=title)
    for k, head in enumerate(heads):
        out.add_column(head, justify="left" if k == 0 else "right")
    for row in rows:
        out.add_row(*row)
    return out
