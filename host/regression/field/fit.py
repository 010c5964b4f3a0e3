"""`fit_field`: from a directory of strokes to the field model and its held-out table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from rich.table import Table

from host.features import Floats
from host.regression.field.bench import Bench
from host.regression.field.data import FieldStrokes
from host.regression.field.model import (
    R11,
    THESIS_SIX,
    Answers,
    FieldModel,
    Recipe,
    fit_field_model,
    hash_of,
)
from host.regression.field.score import (
    averaged,
    bounds,
    coverage,
    flat,
    found_by,
    hardness,
    scores,
    visits,
)
from host.regression.probe_model import from_link
from host.regression.seen import Seen, noise_named
from model_export.schema import ModelSpec

if TYPE_CHECKING:
    from host.regression.field.study import Study

FIELD_FEATURES = (
    *R11,
    "tilt_3_5",
    "tilt_6_9",
    "tilt_10_14",
    "dip_0_2",
    "dip_12_16",
    "ln_peak",
    "ln_width_near",
    "edge_far",
    "ln_width_far",
)
CUBIC = ("asinh_amp", "ln_stdev", "ln_d_far", "ln_force", "dip_6_10", "asinh_rise", "tilt_6_9")

FIELD = Recipe("field", FIELD_FEATURES, 2, True, CUBIC)
SIX_WITH_MAP = Recipe("thesis' six, force map", THESIS_SIX, 3)
SIX_BARE = Recipe("thesis' six", THESIS_SIX, 3, force_map=False)
RECIPES = (FIELD, FIELD.pressure_only(), SIX_WITH_MAP, SIX_BARE)
LEVELS = ("none", "good", "typical", "poor")

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

Tell = Callable[[str], None]


@dataclass(frozen=True)
class HeldOutRow:
    """One line of the held-out table."""

    noise: str
    recipe: str
    strokes: int
    terms: int
    scores: dict[str, float]
    not_found: int

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        head = {"noise": self.noise, "model": self.recipe, "strokes": self.strokes, "terms": self.terms}
        return {**head, "not_found": self.not_found, **flat(self.scores)}


@dataclass(frozen=True)
class FieldFit:
    """A field model, and all that is known about it on lumps it never saw.

    Attributes
    ----------
    spec : ModelSpec
        What `palpate fit` writes; trained at `noise`.
    model : FieldModel
    rows : list of HeldOutRow
    coverage : DataFrame
        Of the 90 % intervals, by group (`score.coverage`).
    excluded : dict
        Why -> how many strokes were left out of training, calibration or test.
    facts : dict
        Domain flags, false alarms, hardness, bounds.
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
    found: pd.DataFrame
    visits: pd.DataFrame
    test: Seen = field(repr=False)
    answers: Answers = field(repr=False)
    studies: list[tuple[Study, pd.DataFrame]] = field(default_factory=list, repr=False)

    def tables(self) -> list[Table]:
        """What `palpate fit --kind field` prints."""
        from host.regression.field.tables import field_tables

        return field_tables(self)

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
            "detectability": self.found.to_dict("records"),
            "two_visits_change_of_diameter_percent": self.visits.to_dict("records"),
            "training": self.spec.training,
            "studies": {study.name: result.to_dict("records") for study, result in self.studies},
        }


def fit_field(
    strokes: FieldStrokes,
    noise: str = "typical",
    seed: int = 1,
    levels: Sequence[str] = LEVELS,
    recipes: Sequence[Recipe] = RECIPES,
    tell: Tell | None = None,
) -> FieldFit:
    """Fit the field model at one noise level, and the held-out table over levels and recipes.

    Parameters
    ----------
    strokes : FieldStrokes
        Of `data.prepare` or `data.read`.
    noise : str
        Level that the model is for; it is among `levels` or added to them.
    seed : int
    levels, recipes : sequences
        Lines of the table; the field recipe is always there.
    tell : callable, optional
        Called with a few words before each step.
    """
    noise_named(noise)
    bench = Bench(strokes, seed)
    rows: list[HeldOutRow] = []
    kept: tuple[FieldModel, Seen, Seen, Seen] | None = None
    for level in dict.fromkeys((*levels, noise)):
        seen: dict[bool, tuple[Seen, Seen, Seen, Seen | None]] = {}
        for recipe in dict.fromkeys((FIELD, *recipes)):
            if tell:
                tell(f"noise {level}: {recipe.name}")
            if recipe.force_map not in seen:
                seen[recipe.force_map] = bench.parts(level, recipe.force_map)
            train, calibration, test, rim = seen[recipe.force_map]
            model = fit_field_model(recipe, train, calibration, rim)
            rows += held_out(level, model, test)
            if level == noise and recipe == FIELD:
                kept = model, train, calibration, test
    assert kept is not None
    model, train, calibration, test = kept
    answers = model.answer(test)
    answered = answers.lump
    if tell:
        tell("false alarms, domain, detectability")
    facts = (
        hardness(test, answers, answered) | bounds(answers, answered) | _flags(bench, model, noise, answers)
    )
    excluded = dict(strokes.excluded)
    for name, part in (("training", train), ("calibration", calibration), ("test", test)):
        for why, rows_out in _left_out(model, part).items():
            excluded[f"{name}: {why}"] = rows_out
    main = next(r for r in rows if (r.noise, r.recipe, r.strokes) == (noise, FIELD.name, 1))
    spec = model.spec(
        {
            "hash": hash_of(train, calibration),
            "n": int(model.lump(train).sum()),
            "lumps": len(bench.split.train),
            "noise": noise,
            "seed": seed,
            "features": _some(train.columns(model.polynomial.names)[model.lump(train)]),
        },
        bench.force_map.as_dict(),
        held_out=flat(main.scores),
    )
    return FieldFit(
        spec=spec,
        model=model,
        noise=noise,
        rows=rows,
        coverage=coverage(test, answers, answered),
        excluded=excluded,
        facts=facts,
        found=found_by(test, answered),
        visits=visits(test, answers.y, answered),
        test=test,
        answers=answers,
    )


def held_out(level: str, model: FieldModel, test: Seen) -> list[HeldOutRow]:
    """The lines of one model: one stroke, and for the field recipe four strokes averaged."""
    answers = model.answer(test)
    terms = len(model.polynomial.terms)
    name = model.recipe.name
    missed = int((~answers.lump).sum())
    out = [HeldOutRow(level, name, 1, terms, scores(test, answers.value, answers.lump), missed)]
    if name == FIELD.name and level != "none":
        mean, y, lost = averaged(test, answers.y, answers.lump)
        if len(mean) > 1:
            everything = np.ones(len(mean), bool)
            out.append(HeldOutRow(level, name, 4, terms, scores(mean, from_link(y), everything), lost))
    return out


def _some(rows: Floats, most: int = 500) -> list[list[float]]:
    """Training rows, evenly chosen, that go with the model for the exporter's error report."""
    return [list(map(float, row)) for row in rows[:: max(1, -(-len(rows) // most))]]


def _left_out(model: FieldModel, part: Seen) -> dict[str, int]:
    short = int((~part.whole).sum())
    out = {"the stroke does not cover the lump": short} if short else {}
    unseen = int((part.whole & ~model.lump(part)).sum())
    return out | ({"no lump found (Amp under 1 % of Base, or Stdev over 20 mm)": unseen} if unseen else {})


def _flags(bench: Bench, model: FieldModel, noise: str, answers: Answers) -> dict[str, float]:
    """Flagged inside and outside the training ranges; false alarms on plain tissue."""
    flagged = ~answers.in_domain
    out = {
        "flagged_inside": float(flagged[answers.lump].mean()),
        "flagged_or_at_an_end_inside": float((flagged | model.at_an_end(answers))[answers.lump].mean()),
    }
    if bench.wide:
        seen = bench.see(bench.wide, np.arange(len(bench.wide)), noise, 2, 300)
        wide = model.answer(seen)
        out["outside_strokes"] = float(len(seen))
        out["outside_no_lump"] = float((~wide.lump).mean())
        out["flagged_outside"] = float((~wide.in_domain[wide.lump]).mean())
        warned = ~wide.in_domain | model.at_an_end(wide)
        out["flagged_or_at_an_end_outside"] = float(warned[wide.lump].mean())
        out["outside_warned_in_all"] = float((warned | ~wide.lump).mean())
    if bench.plain:
        seen = bench.see(bench.plain, np.arange(len(bench.plain)), noise, 4, 400)
        found = model.lump(seen)
        out["plain_strokes"] = float(len(seen))
        out["false_alarms"] = float(found.mean())
    return out


def mean_half_width(answers: Answers) -> Floats:
    """Median half-width of every output on the link scale, over strokes with a lump."""
    return np.median(answers.half[answers.lump], axis=0)
