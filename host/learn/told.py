"""`fit_field`: from a directory of strokes to the field model and its held-out table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.features.map_features import Floats
from palpate.learn.bench import Bench
from palpate.learn.data import Strokes
from palpate.learn.flags import beyond, by_distance, facts_of
from palpate.learn.model import FittedModel, fit_model
from palpate.learn.observed import Observed, noise_named
from palpate.learn.other_tissues import strange_strokes
from palpate.learn.probe_model import from_link, training_hash
from palpate.learn.result import FieldFit
from palpate.learn.scopes import FIELD, TOLD, Recipe
from palpate.learn.score import (
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
from palpate.progress import ProgressCallback
from palpate.sim.probe import sensors
from palpate.sim.probe.sensors import StrokeField

LEVELS = tuple(sensors.LEVELS)

DRAWS_OUTSIDE, DRAWS_PLAIN = 4, 4
_FIRST_OUTSIDE, _FIRST_PLAIN = 300, 400

Parts = tuple[Observed, Observed, Observed, Observed | None]


def fit_field(
    strokes: Strokes,
    noise: str = "typical",
    seed: int = 1,
    levels: Sequence[str] = LEVELS,
    recipe: Recipe = FIELD,
    workers: int | None = None,
    progress: ProgressCallback | None = None,
) -> FieldFit:
    """Fit the field model at one noise level, and the held-out table over levels.

    Parameters
    ----------
    strokes : Strokes
        Of `data.prepare` or `data.read`.
    noise : str
        Level that the model is for; it is among `levels` or added to them.
    seed : int
    levels : sequence of str
        Lines of the table.
    recipe : Recipe
        What the model is made by.
    workers : int, optional
        Processes that observe strokes; by default one for each core.
    progress : callable, optional
        See `progress.ProgressCallback`.
    """
    noise_named(noise)
    levels = tuple(dict.fromkeys((*levels, noise)))
    rows: list[HeldOutRow] = []
    with Bench(strokes, seed, workers=workers, progress=progress) as bench:
        count = _Counter(len(levels), progress)
        for level in levels:
            train, calibration, test, rim = observed = bench.parts(level, recipe)
            strange = strange_strokes(bench, level, recipe) if level == noise else None
            checks = strange.checks if strange else None
            model = fit_model(TOLD.of(recipe), train, calibration, rim, checks, count)
            rows += held_out(level, model, test)
            count("models scored")
            if level == noise:
                kept, parts = model, observed
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


def _result(bench: Bench, model: FittedModel, parts: Parts, noise: str, rows: list[HeldOutRow]) -> FieldFit:
    """The model for use, with everything that the test strokes show about it."""
    train, calibration, test, rim = parts
    answers = model.answer(test)
    answered, recipe = test.found, model.scope.recipe
    excluded = dict(bench.strokes.excluded)
    for name, part in (("training", train), ("rim", rim), ("calibration", calibration), ("test", test)):
        for why, left_out in ({} if part is None else _left_out(part)).items():
            excluded[f"{name}: {why}"] = left_out
    force_map = bench.force_map_of(recipe)
    main = next(r for r in rows if (r.noise, r.strokes) == (noise, 1))
    fitted_to = [train, calibration, *(() if rim is None else (rim,))]
    spec = replace(model, fat_kPa=bench.strokes.lumps[0].case.fat_kPa).spec(
        {
            "hash": training_hash(*(array for part in fitted_to for array in (part.X, part.truth))),
            "n": sum(int(part.found.sum()) for part in fitted_to) - int(calibration.found.sum()),
            "lumps": len(bench.split.train),
            "rim_lumps": len(bench.rim),
            "noise": Path(noise).name,  # of a sensor's file only the name: where it lay means nothing
            "seed": bench.seed,
            "features": _some(train.features(recipe.features)[train.found]),
        },
        None if force_map is None else force_map.as_dict(),
        held_out=flat(main.scores),
    )
    outside, plain = _outside(bench, noise, model)
    within = answered & (beyond(test, model.scope) <= 0)
    flagged = float((~answers.in_domain[within]).mean())
    judged = [(test, answers)] + ([(outside, model.answer(outside))] if outside else [])
    return FieldFit(
        spec=spec,
        model=model,
        noise=noise,
        rows=rows,
        coverage=coverage(test, answers, answered),
        excluded=excluded,
        facts=hardness(test, answers, answered)
        | bounds(answers, answered)
        | facts_of(model, flagged, outside, plain),
        flagged=by_distance(model, judged),
        found=found_by(test, answered),
        visits=visits(test, answers.y, answered),
        test=test,
        answers=answers,
    )


def _outside(bench: Bench, noise: str, model: FittedModel) -> tuple[Observed | None, Observed | None]:
    """Strokes over lumps outside the ranges, as each one's force has it, and over plain tissue."""

    def observed(fields: Sequence[StrokeField], draws: int, first: int) -> Observed | None:
        every = np.arange(len(fields))
        return bench.observe(fields, every, noise, draws, first, model.scope.recipe) if fields else None

    wide = observed(bench.wide, DRAWS_OUTSIDE, _FIRST_OUTSIDE)
    outside = None if wide is None else wide.take(beyond(wide, model.scope) > 0)
    return outside, observed(bench.plain, DRAWS_PLAIN, _FIRST_PLAIN)


def held_out(level: str, model: FittedModel, test: Observed) -> list[HeldOutRow]:
    """The lines of one model: one stroke, and where there is noise four strokes averaged."""
    answers = model.answer(test)
    terms = len(model.polynomial.terms)
    name = model.scope.recipe.name
    missed = int((~test.found).sum())
    out = [HeldOutRow(level, name, 1, terms, scores(test, answers.value, test.found, model.border), missed)]
    if level != "none":
        mean, y, lost = averaged(test, answers.y, test.found)
        if len(mean) > 1:
            found = scores(mean, from_link(y), np.ones(len(mean), bool), model.border)
            out.append(HeldOutRow(level, name, 4, terms, found, lost))
    return out


def _some(rows: Floats, most: int = 500) -> list[list[float]]:
    """Training rows, evenly chosen, that go with the model for the exporter's error report."""
    return [list(map(float, row)) for row in rows[:: max(1, -(-len(rows) // most))]]


def _left_out(part: Observed) -> dict[str, int]:
    short = int((~part.whole).sum())
    out = {"the stroke does not cover the lump": short} if short else {}
    unseen = int((part.whole & ~part.found).sum())
    return out | ({"no lump found (Amp under 1 % of Base, or Stdev over 20 mm)": unseen} if unseen else {})
