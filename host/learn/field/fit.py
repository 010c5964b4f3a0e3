"""`fit_field`: from a directory of strokes to the field model and its held-out table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.features.map_features import Floats
from palpate.learn.field.bench import Bench
from palpate.learn.field.data import FieldStrokes
from palpate.learn.field.flags import flags
from palpate.learn.field.model import FieldModel, fit_field_model, hash_of
from palpate.learn.field.recipe import FIELD, RECIPES, Recipe
from palpate.learn.field.result import FieldFit
from palpate.learn.field.score import (
    HeldOutRow,
    averaged,
    bounds,
    coverage,
    flat,
    found_by,
    hardness,
    scores,
    visits,
)
from palpate.learn.field.strange import strange_strokes
from palpate.learn.observed import ObservedStrokes, noise_named
from palpate.learn.probe_model import from_link
from palpate.progress import ProgressCallback
from palpate.sim.probe import sensors

LEVELS = tuple(sensors.LEVELS)

Parts = tuple[ObservedStrokes, ObservedStrokes, ObservedStrokes, ObservedStrokes | None]


def fit_field(
    strokes: FieldStrokes,
    noise: str = "typical",
    seed: int = 1,
    levels: Sequence[str] = LEVELS,
    recipes: Sequence[Recipe] = RECIPES,
    recipe: Recipe = FIELD,
    workers: int | None = None,
    progress: ProgressCallback | None = None,
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
        Lines of the table.
    recipe : Recipe
        What the model is made by; it is among `recipes` or added to them.
    workers : int, optional
        Processes that observe strokes; by default one for each core.
    progress : callable, optional
        See `progress.ProgressCallback`.
    """
    noise_named(noise)
    levels = tuple(dict.fromkeys((*levels, noise)))
    recipes = tuple(dict.fromkeys((recipe, *recipes)))
    rows: list[HeldOutRow] = []
    with Bench(strokes, seed, workers=workers, progress=progress) as bench:
        count = _Counter(len(levels) * len(recipes), progress)
        for level in levels:
            observed: dict[tuple[bool, bool], Parts] = {}
            for tried in recipes:
                moved = tried.force_map, tried.force_map and tried.displacement
                if moved not in observed:
                    observed[moved] = bench.parts(level, tried)
                train, calibration, test, rim = observed[moved]
                kept_one = level == noise and tried == recipe
                strange = strange_strokes(bench, level, tried) if kept_one else None
                checks = strange.checks if strange else None
                model = fit_field_model(tried, train, calibration, rim, step=count, checks=checks)
                rows += held_out(level, model, test, averages=tried == recipe)
                count("models scored")
                if kept_one:
                    kept, parts = model, observed[moved]
        return _result(bench, kept, parts, noise, rows)


class _Counter:
    """Counts the steps done with each model, and reports them."""

    def __init__(self, models: int, progress: ProgressCallback | None) -> None:
        self.models, self.progress = models, progress
        self.done: dict[str, int] = {}

    def __call__(self, what: str) -> None:
        self.done[what] = self.done.get(what, 0) + 1
        if self.progress is not None:
            self.progress(what, self.done[what], self.models)


def _result(bench: Bench, model: FieldModel, parts: Parts, noise: str, rows: list[HeldOutRow]) -> FieldFit:
    """The model for use, with everything that the test strokes show about it."""
    train, calibration, test, rim = parts
    answers = model.answer(test)
    answered = answers.lump
    facts = hardness(test, answers, answered) | bounds(answers, answered)
    shares, by_distance = flags(bench, model, noise, test, answers)
    excluded = dict(bench.strokes.excluded)
    for name, part in (("training", train), ("rim", rim), ("calibration", calibration), ("test", test)):
        for why, left_out in ({} if part is None else _left_out(model, part)).items():
            excluded[f"{name}: {why}"] = left_out
    force_map = bench.force_map_of(model.recipe)
    main = next(r for r in rows if (r.noise, r.recipe, r.strokes) == (noise, model.recipe.name, 1))
    told = bench.strokes.lumps[0].case.fat_kPa
    spec = replace(model, fat_kPa=told).spec(
        {
            "hash": hash_of(train, calibration, *(() if rim is None else (rim,))),
            "n": int(model.lump(train).sum()) + (0 if rim is None else int(model.lump(rim).sum())),
            "lumps": len(bench.split.train),
            "rim_lumps": len(bench.rim),
            "noise": Path(noise).name,  # of a sensor's file only the name: where it lay means nothing
            "seed": bench.seed,
            "features": _some(train.columns(model.polynomial.names)[model.lump(train)]),
        },
        None if force_map is None else force_map.as_dict(),
        held_out=flat(main.scores),
    )
    return FieldFit(
        spec=spec,
        model=model,
        noise=noise,
        rows=rows,
        coverage=coverage(test, answers, answered),
        excluded=excluded,
        facts=facts | shares,
        flagged=by_distance,
        found=found_by(test, answered),
        visits=visits(test, answers.y, answered),
        test=test,
        answers=answers,
    )


def held_out(level: str, model: FieldModel, test: ObservedStrokes, averages: bool) -> list[HeldOutRow]:
    """The lines of one model: one stroke, and if `averages` says so four strokes averaged."""
    answers = model.answer(test)
    terms = len(model.polynomial.terms)
    name = model.recipe.name
    missed = int((~answers.lump).sum())
    out = [HeldOutRow(level, name, 1, terms, scores(test, answers.value, answers.lump, model.border), missed)]
    if averages and level != "none":
        mean, y, lost = averaged(test, answers.y, answers.lump)
        if len(mean) > 1:
            found = scores(mean, from_link(y), np.ones(len(mean), bool), model.border)
            out.append(HeldOutRow(level, name, 4, terms, found, lost))
    return out


def _some(rows: Floats, most: int = 500) -> list[list[float]]:
    """Training rows, evenly chosen, that go with the model for the exporter's error report."""
    return [list(map(float, row)) for row in rows[:: max(1, -(-len(rows) // most))]]


def _left_out(model: FieldModel, part: ObservedStrokes) -> dict[str, int]:
    short = int((~part.whole).sum())
    out = {"the stroke does not cover the lump": short} if short else {}
    unseen = int((part.whole & ~model.lump(part)).sum())
    return out | ({"no lump found (Amp under 1 % of Base, or Stdev over 20 mm)": unseen} if unseen else {})
