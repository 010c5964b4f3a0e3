"""A model of solid lumps, learnt from emulated strokes and held to computed ones.

The emulator (`emulator.py`) knows the computed lumps and gives as many others as a model of two stages needs
(`any_tissue.model`). How wide its intervals must be is then counted on computed lumps that emulator and model
have not seen: the emulator's own error is in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.regression.any_tissue.model import TissueModel, fit_tissue_model, truth
from palpate.regression.any_tissue.observed import ObservedInTissue, TissueLump, joined, observe
from palpate.regression.any_tissue.study import TissueStudy
from palpate.regression.balls.across import place_mm
from palpate.regression.balls.emulator import StrokeEmulator, fit_emulator
from palpate.regression.conformal import LEVEL, conformal_quantile
from palpate.regression.probe_model import Polynomial, fit_polynomial
from palpate.regression.table import r_squared
from palpate.sim.tissue.solid.design import ball_cases

EMULATED, DRAWS, FOLDS = 4000, 3, 4
EMULATED_SEED = 77
"""Of the emulated lumps; computed ones are of another."""

Step = Callable[[str], None]


@dataclass(frozen=True)
class Trained:
    """What emulated strokes teach.

    `alone` does without the press; `across` estimates ln of the width across from the same features, and
    stays on the host.
    """

    model: TissueModel
    alone: TissueModel
    across: Polynomial

    def study(self, seen: ObservedInTissue, with_press: bool) -> BallStudy:
        """What it says of computed lumps; those of `seen` that show none are only counted."""
        model, found = self.model if with_press else self.alone, seen.take(seen.found)
        said = model.answer(found)
        width = self.across.predict(self.model.inputs(found))[:, 0] if with_press else None
        lost = float((~seen.found).mean())
        inside = model.in_domain(found)
        return BallStudy(found, said.y, said.half, said.hard, lost, inside, width)


@dataclass(frozen=True)
class BallStudy(TissueStudy):
    """`width` (n,), if it is there: ln of the width across, mm."""

    width: Floats | None = None

    def row(self, words: str) -> dict[str, object]:
        """As of any tissue, and across the stroke: width, relative, and place, mm."""
        out = super().row(words)
        of_width, offset = across_truth(self.seen)
        if self.width is not None:
            out["width_r2"] = r_squared(of_width, self.width)
            out["width_error"] = float(np.median(np.expm1(np.abs(self.width - of_width))))
        off = np.abs(place_mm(self.seen.columns) - offset)
        beside = off[offset > 0]
        out["place_error"] = float(np.median(beside)) if len(beside) else float("nan")
        return out | {"place_right": float((off < PLACE_MM).mean())}


PLACE_MM = 2.0
"""A place across within this is counted as right; the median error is of lumps beside the line."""


def across_truth(seen: ObservedInTissue) -> tuple[Floats, Floats]:
    """ln of the width across the stroke, mm, and the distance from its line, mm; (n,) each."""
    return seen.across[:, 0], seen.across[:, 1]


def observed(
    lumps: Sequence[TissueLump], noise: str, seed: int, force_map: bytes, first: int = 0, draws: int = DRAWS
) -> ObservedInTissue:
    """Some strokes with their press over each lump, each in a fat and by a probe and a hand of its own."""
    return joined([observe(lumps, noise, 1000 * seed + k, force_map, first=first) for k in range(draws)])


def emulated(
    emulator: StrokeEmulator, noise: str, seed: int, force_map: bytes, lumps: int = EMULATED
) -> ObservedInTissue:
    """One stroke over each of so many emulated lumps."""
    cases = ball_cases(lumps, EMULATED_SEED)
    parts = [emulator.lumps(cases[k : k + _AT_ONCE]) for k in range(0, len(cases), _AT_ONCE)]
    return joined(
        [
            observe(part, noise, emulated_seed(seed), force_map, first=k * _AT_ONCE // 3)
            for k, part in enumerate(parts)
        ]
    )


_AT_ONCE = 1500
"""Cases whose images are in memory together; three a lump."""


def emulated_seed(seed: int) -> int:
    """Of the noise of emulated strokes, which is not that of computed ones."""
    return 1000 * seed + 900


def train(seen: ObservedInTissue) -> Trained:
    """Fit to emulated strokes."""
    model = fit_tissue_model(seen, True)
    found = seen.take(seen.found)
    X, Y = model.inputs(found), across_truth(found)[0][:, None]
    stroke = model.stroke
    across = fit_polynomial(stroke.names, X, Y, found.group, stroke.terms, Y.min(0), Y.max(0))
    return Trained(model, fit_tissue_model(seen, False), across)


@dataclass(frozen=True)
class Fold:
    """What models say of the lumps that they were fitted without: by noise level, with and without press."""

    studies: dict[tuple[str, bool], BallStudy]


def held_out_fold(
    lumps: Sequence[TissueLump],
    fold: int,
    levels: Sequence[str],
    seed: int,
    force_map: bytes,
    count: int = EMULATED,
) -> Fold:
    """Leave out one of `FOLDS` equal parts, emulate and fit without it, and ask about it."""
    ends = np.linspace(0, len(lumps), FOLDS + 1).astype(int)
    first, last = int(ends[fold]), int(ends[fold + 1])
    emulator = fit_emulator([*lumps[:first], *lumps[last:]])
    studies = {}
    for level in levels:
        trained = train(emulated(emulator, level, seed, force_map, count))
        seen = observed(lumps[first:last], level, seed, force_map, first)
        for with_press in (False, True):
            studies[level, with_press] = trained.study(seen, with_press)
    return Fold(studies)


def judged(parts: Sequence[BallStudy]) -> BallStudy:
    """The folds as one; each with intervals as wide as the others' lumps ask for."""
    wide = []
    for k, part in enumerate(parts):
        factors = width_factors([*parts[:k], *parts[k + 1 :]])
        wide.append(part.half * factors[:, part.hard.astype(int)].T)
    widths = [part.width for part in parts if part.width is not None]
    shown = np.array([len(part.seen.found) for part in parts])
    lost = np.array([part.lost for part in parts])
    asked = shown / (1 - lost)
    return BallStudy(
        joined([part.seen for part in parts]),
        np.concatenate([part.y for part in parts]),
        np.concatenate(wide),
        np.concatenate([part.hard for part in parts]),
        float((lost * asked).sum() / asked.sum()),
        np.concatenate([part.in_domain for part in parts if part.in_domain is not None]),
        np.concatenate(widths) if widths else None,
    )


def width_factors(parts: Sequence[BallStudy]) -> Floats:
    """By how much intervals must be wider to hold `LEVEL` of computed lumps: (outputs, 2), soft and hard."""
    score = np.concatenate([np.abs(part.y - truth(part.seen)) / part.half for part in parts])
    hard = np.concatenate([part.hard for part in parts])
    # strokes over one lump err alike: it is lumps that the quantile has to count
    lumps = len(np.unique(np.concatenate([part.seen.group for part in parts])))
    level = min(1.0, LEVEL * (1 + 1 / lumps))
    return np.array([[_quantile(of, hard == side, level) for side in (False, True)] for of in score.T])


def _quantile(score: Floats, side: NDArray[np.bool_], level: float) -> float:
    return conformal_quantile(score[side] if side.sum() >= _FEWEST else score, level)


_FEWEST = 50


def widened(model: TissueModel, factors: Floats) -> TissueModel:
    """The model with intervals wider by these factors, (outputs, 2)."""
    return replace(model, widths=replace(model.widths, quantiles=model.widths.quantiles * factors))
