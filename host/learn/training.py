"""A model of solid lumps, learnt from emulated strokes and computed ones, and held to others.

The emulator (`emulator.py`) knows the computed lumps and gives as many others as a model of two stages needs
(`model`); the computed ones are learnt from beside them, since they have none of its error. How
wide its intervals must be is then counted on computed lumps that emulator and model have not seen: the
emulator's own error is in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.features.map_features import Floats
from palpate.learn.across import WidthModel, across_truth, fit_place, fit_width, level_of, width_factor
from palpate.learn.conformal import quantile_of_part
from palpate.learn.emulator import StrokeEmulator, fit_emulator
from palpate.learn.lumps import LumpStrokes
from palpate.learn.model import FittedModel, fit_model
from palpate.learn.observed import Observed, joined, observe_in_any_fat
from palpate.learn.scopes import SOLID, Scope
from palpate.learn.score import of_output
from palpate.learn.study import Study
from palpate.sim.tissue.solid.design import COVERED, ball_cases

EMULATED, DRAWS, FOLDS = 4000, 3, 4
OWN_DRAWS = 6
"""Strokes over each computed lump that a model learns from."""
EMULATED_SEED = 77
"""Of the emulated lumps; computed ones are of another."""

Step = Callable[[str], None]


@dataclass(frozen=True)
class Trained:
    """What strokes teach.

    `alone` does without the press; `width` estimates the width across from the same features as `model`, and
    stays on the host.
    """

    model: FittedModel
    alone: FittedModel
    width: WidthModel

    def study(self, seen: Observed, with_press: bool) -> SolidStudy:
        """What it says of computed lumps; those of `seen` that show none are only counted."""
        if not with_press:
            return SolidStudy.of(self.alone, seen)
        width, half = self.width.answer(self.model.inputs(seen.take(seen.found)))
        return SolidStudy.of(self.model, seen, width=width, width_half=half)


@dataclass(frozen=True)
class SolidStudy(Study):
    """`width` and `place`, (n,), if they are there: ln of the width across, mm, and place across, mm; half of
    their intervals."""

    width: Floats | None = None
    width_half: Floats | None = None
    place: Floats | None = None
    place_half: Floats | None = None
    scope: Scope = field(default=SOLID, kw_only=True)

    def row(self, words: str) -> dict[str, object]:
        """As of any tissue, and across the stroke: width, relative, and place, mm."""
        out = super().row(words)
        of_width, offset = across_truth(self.seen)
        if self.width is not None:
            out |= of_output("width", of_width, self.width, self.width_half)
        if self.place is not None and self.place_half is not None and (offset > 0).any():
            error, beside = np.abs(self.place - offset), offset > 0
            out["place_error"] = float(np.median(error[beside]))
            out["place_covered"] = float((error <= self.place_half)[beside].mean())
            out["place_covered_all"] = float((error <= self.place_half).mean())
            out["place_half"] = float(np.median(self.place_half[beside]))
            out["place_right"] = float((error < PLACE_MM).mean())
        return out


PLACE_MM = 2.0
"""A place across within this is counted as right; median error and coverage are of lumps beside the line."""


def observed(
    lumps: Sequence[LumpStrokes], noise: str, seed: int, force_map: bytes, first: int = 0, draws: int = DRAWS
) -> Observed:
    """Some strokes with their press over each lump, each in a fat and by a probe and a hand of its own."""
    return joined(
        [observe_in_any_fat(lumps, noise, 1000 * seed + k, force_map, first=first) for k in range(draws)]
    )


def taught(
    emulator: StrokeEmulator,
    lumps: Sequence[LumpStrokes],
    noise: str,
    seed: int,
    force_map: bytes,
    count: int,
) -> Observed:
    """What a model learns from: strokes over so many emulated lumps, and over those behind the emulator."""
    cases = ball_cases(count, EMULATED_SEED, COVERED)
    others = [
        observe_in_any_fat(
            emulator.lumps(cases[k : k + _AT_ONCE]), noise, emulated_seed(seed), force_map, first=k // 3
        )
        for k in range(0, len(cases), _AT_ONCE)
    ]
    return joined([*others, observed(lumps, noise, seed, force_map, first=count, draws=OWN_DRAWS)])


_AT_ONCE = 1500
"""Cases whose images are in memory together; three a lump."""


def emulated_seed(seed: int) -> int:
    """Of the noise of emulated strokes, which is not that of computed ones."""
    return 1000 * seed + 900


def train(seen: Observed) -> Trained:
    """Fit to strokes of `taught`."""
    model = fit_model(SOLID, seen)
    found = seen.take(seen.found)
    width = fit_width(model.polynomial, model.inputs(found), found)
    return Trained(model, fit_model(SOLID.stroke_alone, seen), width)


Studies = dict[tuple[str, bool], SolidStudy]
"""What models say of the lumps that they were fitted without: by noise level, with and without press."""


def held_out_fold(
    lumps: Sequence[LumpStrokes],
    fold: int,
    levels: Sequence[str],
    seed: int,
    force_map: bytes,
    count: int,
) -> Studies:
    """Leave out one of `FOLDS` equal parts, emulate and fit without it, and ask about it."""
    ends = np.linspace(0, len(lumps), FOLDS + 1).astype(int)
    first, last = int(ends[fold]), int(ends[fold + 1])
    rest = [*lumps[:first], *lumps[last:]]
    emulator = fit_emulator(rest)
    studies: Studies = {}
    for level in levels:
        trained = train(taught(emulator, rest, level, seed, force_map, count))
        seen = observed(lumps[first:last], level, seed, force_map, first)
        for with_press in (False, True):
            studies[level, with_press] = trained.study(seen, with_press)
    return studies


def judged(parts: Sequence[SolidStudy]) -> SolidStudy:
    """The folds as one; each with intervals as wide as the others' lumps ask for."""
    wide, halves, found = [], [], []
    for k, part in enumerate(parts):
        others = [*parts[:k], *parts[k + 1 :]]
        factors = width_factors(others)
        wide.append(part.half * factors[:, part.hard.astype(int)].T)
        if part.width_half is not None:
            halves.append(part.width_half * across_factor(others))
        if (place := fit_place([other.seen for other in others])) is not None:
            found.append(place.answer(part.seen.columns))
    widths = [part.width for part in parts if part.width is not None]
    told = tuple(map(np.concatenate, zip(*found))) if len(found) == len(parts) else (None, None)
    shown = np.array([len(part.seen.found) for part in parts])
    lost = np.array([part.lost for part in parts])
    asked = shown / (1 - lost)
    return SolidStudy(
        joined([part.seen for part in parts]),
        np.concatenate([part.y for part in parts]),
        np.concatenate(wide),
        np.concatenate([part.hard for part in parts]),
        float((lost * asked).sum() / asked.sum()),
        np.concatenate([part.in_domain for part in parts if part.in_domain is not None]),
        np.concatenate(widths) if widths else None,
        np.concatenate(halves) if halves else None,
        told[0],
        told[1],
    )


def across_factor(parts: Sequence[SolidStudy]) -> float:
    """By how much the width across must have wider intervals to hold `conformal.LEVEL` of computed lumps; of
    parts that tell it."""
    told = [(p.width, p.width_half) for p in parts if p.width is not None and p.width_half is not None]
    width, half = map(np.concatenate, zip(*told))
    return width_factor(width, half, joined([part.seen for part in parts]))


def width_factors(parts: Sequence[SolidStudy]) -> Floats:
    """By how much intervals must be wider to hold `conformal.LEVEL` of computed lumps.

    (outputs, 2), soft and hard."""
    score = np.concatenate([np.abs(part.y - part.seen.truth) / part.half for part in parts])
    hard = np.concatenate([part.hard for part in parts])
    level = level_of(np.concatenate([part.seen.group for part in parts]))
    sides = (False, True)
    return np.array([[quantile_of_part(of, hard == side, level) for side in sides] for of in score.T])


def widened(model: FittedModel, factors: Floats) -> FittedModel:
    """The model with intervals wider by these factors, (outputs, 2)."""
    return replace(model, widths=replace(model.widths, quantiles=model.widths.quantiles * factors))
