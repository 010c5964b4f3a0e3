"""Strokes that the field model is not for and that look as if it were: what its checks are fitted to.

Softer fat over a lump gives very nearly the stroke of a larger lump; the press before the stroke tells the
two apart. So what is in another tissue, or under another face, is noticed by its press, and its amount is
what the check is fitted to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np

from palpate.features.map_features import Floats
from palpate.features.press_features import OUTER
from palpate.learn.bench import Bench
from palpate.learn.checks import fit_checks
from palpate.learn.checks import joined as checks_joined
from palpate.learn.data import FEWEST_LUMPS, OtherTissue
from palpate.learn.observed import OF_THE_DISPLACEMENT, Observed, joined
from palpate.learn.scopes import Recipe
from palpate.model_export.schema import FirstStage
from palpate.model_export.vocabulary import OF_THE_PRESS
from palpate.sim.probe.sensors import Noise
from palpate.sim.probe.two_lumps import APART_MM, random_pair

FAT = (1.18, 1.65)
"""How much stiffer or softer another fat is: by a factor between these."""

TO_BE_NOTICED = {"fat_kPa": log(1.3), "probe_radius_mm": log(1.1), "fat_stiffening": 2.0}
"""How much of each is 1 to a check: differences of logarithms, and of b."""

FALSE_ALARMS = 0.003
"""Share of the model's own strokes that each of the press's checks may leave out."""

MOST_FEATURES, MOST_TERMS, MOST_TERMS_OF_PRESS = 12, 64, 45
"""Of the check against two lumps, and of the press's: a board has no room for all 120 and 66."""

_FIRST = {"two_lumps": 700, "softer": 800, "stiffer": 850, "other": 870}
_DRAWS = 2
_OTHERS_FROM = 1_000_000
"""Numbers of other tissues among those of lumps."""


@dataclass(frozen=True)
class PressedStrokes:
    """Strokes in tissues that give way more, or less, than the model's.

    seen : Observed; far : (n), how far each is off, in units of `TO_BE_NOTICED`
    """

    seen: Observed
    far: Floats


@dataclass(frozen=True)
class StrangeToTold:
    """What a model of this recipe is to notice: two lumps by the stroke, other tissues by the press."""

    recipe: Recipe
    two_lumps: Observed
    tissues: Mapping[str, PressedStrokes]

    @property
    def press(self) -> tuple[str, ...]:
        """Features by which tissues are told apart; the outer columns read what the others do."""
        some = (name for name in OF_THE_PRESS if name not in OUTER)
        with_depth = self.recipe.displacement
        return ("ln_force", *(name for name in some if with_depth or name not in OF_THE_DISPLACEMENT))

    def checks(self, own: Observed) -> FirstStage:
        """Fitted to these and to the model's own strokes, which show a lump."""
        names = tuple(name for name in self.recipe.features if name not in self.press)
        pairs = {"two_lumps": (self.two_lumps.features(names), self.two_lumps.group)}
        checks = fit_checks(
            names,
            own.features(names),
            own.group,
            pairs,
            most_features=MOST_FEATURES,
            most_terms=MOST_TERMS,
        )
        own = own.take(own.pressed)
        if not self.tissues or not len(own):
            return checks
        tissues = {kind: (of.seen.features(self.press), of.seen.group) for kind, of in self.tissues.items()}
        far = {kind: of.far for kind, of in self.tissues.items()}
        by_press = fit_checks(
            self.press,
            own.features(self.press),
            own.group,
            tissues,
            FALSE_ALARMS,
            most_terms=MOST_TERMS_OF_PRESS,
            how_far=far,
        )
        return checks_joined(checks, by_press)


def strange_strokes(bench: Bench, noise: Noise | str, recipe: Recipe) -> StrangeToTold | None:
    """Such strokes, over training lumps; None where they are too few.

    Calibration and test lumps are in none. Moduli and the force times s leave the displacement as it is, so
    another fat needs no simulation; of the other tissues there are presses (`presses.other_cases`).
    """
    train = bench.split.train
    if len(train) < FEWEST_LUMPS:
        return None
    rng = np.random.default_rng(bench.seed)
    pairs, tissues = list(bench.lumps), {}
    lumps = bench.strokes.lumps
    for k in train:
        pairs[k] = random_pair(lumps[k].strokes, APART_MM, rng, lumps[k].press)
    seen = bench.observe(pairs, train, noise, 1, _FIRST["two_lumps"], recipe)
    two_lumps = seen.take(seen.found)
    if any(lumps[k].press for k in train):
        others = _others(bench, noise, recipe)
        for kind, way in (("softer", -1), ("stiffer", 1)):
            factors = np.ones(len(lumps))
            factors[train] = np.exp(way * rng.uniform(log(FAT[0]), log(FAT[1]), len(train)))
            fats = [lump.scaled(s).field for lump, s in zip(lumps, factors)]
            seen = bench.observe(fats, train, noise, _DRAWS, _FIRST[kind], recipe)
            far = np.abs(np.log(factors[seen.group])) / TO_BE_NOTICED["fat_kPa"]
            tissues[kind] = _pressed_only([PressedStrokes(seen, far), *others.get(kind, ())])
    return StrangeToTold(recipe, two_lumps, tissues)


def _others(bench: Bench, noise: Noise | str, recipe: Recipe) -> dict[str, list[PressedStrokes]]:
    """The other tissues by the check that is to notice them: a larger face sinks in less, as into softer fat
    that is thin, a smaller one more."""
    out: dict[str, list[PressedStrokes]] = {}
    others = bench.strokes.others
    if not others:
        return out
    every = np.arange(len(others))
    seen = bench.observe([of.field for of in others], every, noise, _DRAWS, _FIRST["other"], recipe)
    off = np.array([of.off for of in others]) / [TO_BE_NOTICED[of.kind] for of in others]
    stiffer = np.array([_stiffer(of) for of in others])
    for kind, some in (("softer", ~stiffer), ("stiffer", stiffer)):
        rows = some[seen.group]
        part = seen.take(rows)
        far = np.abs(off[part.group])
        out[kind] = [PressedStrokes(replace(part, group=part.group + _OTHERS_FROM), far)]
    return out


def _stiffer(of: OtherTissue) -> bool:
    return of.kind == "fat_stiffening" or of.off < 0


def _pressed_only(parts: Sequence[PressedStrokes]) -> PressedStrokes:
    """All of them whose press the probe saw enough of."""
    seen, far = joined([part.seen for part in parts]), np.concatenate([part.far for part in parts])
    enough = seen.whole & seen.pressed
    return PressedStrokes(seen.take(enough), far[enough])
