"""Checks by which a model that is told its tissue notices another one.

Softer fat over a lump gives very nearly the stroke of a larger lump; the press before the stroke tells the
two apart. So what is in another tissue, or under another face, is noticed by its press, and its amount is
what the check is fitted to.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import log

import numpy as np

from palpate.features.map_features import Floats
from palpate.features.press_features import OUTER
from palpate.learn.checks import fit_checks
from palpate.learn.data import OtherTissue, Strokes
from palpate.learn.observed import OF_THE_DISPLACEMENT, Observed, joined
from palpate.learn.scopes import Recipe
from palpate.learn.strange import StrangeStrokes
from palpate.model_export.schema import FirstStage
from palpate.model_export.vocabulary import OF_THE_PRESS

FAT = (1.18, 1.65)
"""How much stiffer or softer another fat is: by a factor between these."""

TO_BE_NOTICED = {"fat_kPa": log(1.3), "probe_radius_mm": log(1.1), "fat_stiffening": 2.0}
"""How much of each is 1 to a check: differences of logarithms, and of b."""

FALSE_ALARMS = 0.005
"""Share of the model's own strokes that each of these checks may leave out."""

MOST_TERMS = 45
"""A board has no room for all 66."""

_DRAWS = 2
_OTHERS_FROM = 1_000_000
"""Numbers of other tissues among those of lumps."""


def press_checks(watch: StrangeStrokes, strokes: Strokes, own: Observed, recipe: Recipe) -> FirstStage:
    """A check for tissue that gives way more, `softer`, and one for less, `stiffer`.

    Parameters
    ----------
    watch : StrangeStrokes
        Observes.
    strokes : Strokes
        Moduli and the force times s leave the displacement as it is, so another fat needs no simulation; of
        the other tissues there are presses.
    own : Observed
        The model's own strokes.
    recipe : Recipe
        Of the model: without displacement, so are the checks.
    """
    names = _names(recipe)
    own = own.take(own.found)
    rng = np.random.default_rng(watch.seed)
    parts: dict[str, list[tuple[Observed, Floats]]] = {}
    for kind, way in (("softer", -1), ("stiffer", 1)):
        factors = np.exp(way * rng.uniform(log(FAT[0]), log(FAT[1]), len(strokes.lumps)))
        seen = joined([watch.in_fat(strokes.lumps, factors, kind, k) for k in range(_DRAWS)])
        parts[kind] = [(seen, np.abs(np.log(factors[seen.group])) / TO_BE_NOTICED["fat_kPa"])]
    for kind, seen, off in _others(watch, strokes.others):
        parts[kind].append((seen, off))
    tissues, how_far = {}, {}
    for kind, pairs in parts.items():
        seen = joined([of for of, _ in pairs])
        tissues[kind] = seen.features(names)[seen.whole], seen.group[seen.whole]
        how_far[kind] = np.concatenate([off for _, off in pairs])[seen.whole]
    X, most = own.features(names), MOST_TERMS
    return fit_checks(names, X, own.group, tissues, FALSE_ALARMS, most_terms=most, how_far=how_far)


def _names(recipe: Recipe) -> tuple[str, ...]:
    """Features by which tissues are told apart; the outer columns read what the others do."""
    some = (name for name in OF_THE_PRESS if name not in OUTER)
    return ("ln_force", *(n for n in some if recipe.displacement or n not in OF_THE_DISPLACEMENT))


def _others(watch: StrangeStrokes, others: Sequence[OtherTissue]) -> Iterator[tuple[str, Observed, Floats]]:
    """The check that is to notice them, other tissues, how far each is off.

    A larger face sinks in less, as into softer fat that is thin, a smaller one more.
    """
    if not others:
        return
    seen = joined([watch.as_they_are([of.strokes for of in others], k) for k in range(_DRAWS)])
    off = np.array([of.off / TO_BE_NOTICED[of.kind] for of in others])
    stiffer = np.array([of.kind == "fat_stiffening" or of.off < 0 for of in others])
    for kind, some in (("softer", ~stiffer), ("stiffer", stiffer)):
        part = seen.take(some[seen.group])
        yield kind, replace(part, group=part.group + _OTHERS_FROM), np.abs(off[part.group])
