"""`fit_field`: from a directory of strokes to the field model and its held-out table."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from host.features import Floats
from host.regression.field.bench import Bench
from host.regression.field.data import FieldStrokes
from host.regression.field.flags import flags
from host.regression.field.model import FieldModel, fit_field_model, hash_of
from host.regression.field.recipe import FIELD, RECIPES, Recipe
from host.regression.field.result import FieldFit
from host.regression.field.score import (
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
from host.regression.probe_model import from_link
from host.regression.seen import Seen, noise_named

LEVELS = ("none", "good", "typical", "poor")

Tell = Callable[[str], None]


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
        hardness(test, answers, answered)
        | bounds(answers, answered)
        | flags(bench, model, noise, test, answers)
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
