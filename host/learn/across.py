"""What a model of solid lumps says across the stroke: how wide a lump is, and where it lies.

The probe has no room for either; the host works them out (`palpate.answer`). The width is a polynomial of the
second stage's features, learnt as that stage is. The place is the middle of the bump that the columns see,
stretched: a face curved along the stroke alone shows it nearer to the middle than it is. How wide the place's
interval must be depends on how clear that bump is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.answer.across import places
from palpate.features.map_features import Floats
from palpate.learn.conformal import LEVEL, conformal_quantile, fit_sigma, out_of_fold
from palpate.learn.observed import Observed
from palpate.learn.probe_model import Polynomial, estimates_of, fit_polynomial, floats, stage_of
from palpate.model_export.schema import Across

FOLDS = 4
FEWEST = 6
"""Strokes over lumps beside the line; of fewer no place can be learnt."""

_ROUNDS = 6
_FAR = 1.5
"""Residuals over so many expected ones pull at the stretch no more than that."""
_SMALLEST_SHARE = 0.1


def across_truth(seen: Observed) -> tuple[Floats, Floats]:
    """ln of the width across the stroke, mm, and the distance from its line, mm; (n,) each."""
    return seen.across[:, 0], seen.across[:, 1]


def level_of(groups: NDArray[np.int64]) -> float:
    """The quantile that holds `LEVEL` of fresh lumps: strokes over one lump err alike, so lumps count."""
    return min(1.0, LEVEL * (1 + 1 / len(np.unique(groups))))


@dataclass(frozen=True)
class WidthModel:
    """ln of the width; spread (features + 2): of ln of its half-width, over 1, the features, and itself."""

    polynomial: Polynomial
    spread: Floats

    def answer(self, X: Floats) -> tuple[Floats, Floats]:
        """Estimates and half-widths, (n,) each, from the second stage's features."""
        y, z = self.polynomial.predict(X), self.polynomial.standard(X)
        return y[:, 0], np.exp(np.column_stack([np.ones(len(X)), z, y]) @ self.spread)

    def wider(self, factor: float) -> WidthModel:
        """The same with intervals wider by this factor."""
        first = self.spread[:1] + np.log(factor)
        return WidthModel(self.polynomial, np.concatenate([first, self.spread[1:]]))


def fit_width(stroke: Polynomial, X: Floats, seen: Observed) -> WidthModel:
    """Learn from strokes that found a lump; X (n, features): as `stroke`, the second stage, takes them."""
    Y = across_truth(seen)[0][:, None]

    def fitted(x: Floats, y: Floats, groups: NDArray[np.int64]) -> Polynomial:
        return fit_polynomial(stroke.names, x, y, groups, stroke.terms, Y.min(0), Y.max(0))

    def predictor(x: Floats, y: Floats, groups: NDArray[np.int64]) -> Callable[[Floats], Floats]:
        return fitted(x, y, groups).predict

    polynomial = fitted(X, Y, seen.group)
    guess = out_of_fold(X, Y, seen.group, predictor, FOLDS)
    _, spread = fit_sigma(polynomial.standard(X), guess, Y - guess, seen.group)
    return WidthModel(polynomial, spread[:, 0])


def width_factor(width: Floats, half: Floats, seen: Observed) -> float:
    """By how much intervals (n,) of these estimates (n,) must be wider to hold `LEVEL` of the lumps."""
    score = np.abs(width - across_truth(seen)[0]) / half
    return conformal_quantile(score, level_of(seen.group))


@dataclass(frozen=True)
class PlaceModel:
    """stretch: of the bump's middle; spread (2): of ln of the half-width, over 1 and `ln_blur`."""

    stretch: float
    spread: Floats

    def answer(self, columns: Floats) -> tuple[Floats, Floats]:
        """Places and half-widths, mm, (n,) each, from the columns' responses (n, columns)."""
        return self._answer(*places(columns))

    def _answer(self, middle: Floats, ln_blur: Floats) -> tuple[Floats, Floats]:
        return self.stretch * middle, np.exp(self.spread[0] + self.spread[1] * ln_blur)


def fit_place(parts: Sequence[Observed]) -> PlaceModel | None:
    """Learn from parts of computed strokes with no lump in common; None where too few lie beside the line.

    The intervals hold `LEVEL` of the lumps beside the line, each asked with stretch and spread of the other
    parts: in a set with most lumps on the line, where errors are nearly none, all of them would make
    narrow intervals, and nobody knows which lump is on it.
    """
    beside = [part.take(across_truth(part)[1] > 0) for part in parts]
    seen = [places(part.columns) for part in beside]
    true = [across_truth(part)[1] for part in beside]
    if len(parts) < 2 or sum(map(len, true)) - max(map(len, true)) < FEWEST:
        return None
    scores = []
    for k, part in enumerate(seen):
        others = [n for n in range(len(parts)) if n != k]
        place, half = _fitted([seen[n] for n in others], [true[n] for n in others])._answer(*part)
        scores.append(np.abs(place - true[k]) / half)
    level = level_of(np.concatenate([part.group for part in beside]))
    all_of_them = _fitted(seen, true)
    wider = np.array([np.log(conformal_quantile(np.concatenate(scores), level)), 0.0])
    return PlaceModel(all_of_them.stretch, all_of_them.spread + wider)


def _fitted(seen: Sequence[tuple[Floats, Floats]], true: Sequence[Floats]) -> PlaceModel:
    """Weighted least squares in turn with the size of what is left."""
    middle, ln_blur = (np.concatenate(part) for part in zip(*seen))
    off = np.concatenate(true)
    blurred = np.column_stack([np.ones(len(off)), ln_blur])
    weight, stretch, spread = np.ones(len(off)), 1.0, np.zeros(2)
    for _ in range(_ROUNDS):
        stretch = float((weight * middle) @ off / ((weight * middle) @ middle))
        left = np.abs(off - stretch * middle)
        spread = np.linalg.lstsq(
            blurred, np.log(np.maximum(left, np.quantile(left, _SMALLEST_SHARE))), rcond=None
        )[0]
        sigma = np.exp(blurred @ spread)
        weight = sigma**-2 / np.maximum(1.0, left / sigma / _FAR)
    return PlaceModel(stretch, spread)


def across_of(width: WidthModel, place: PlaceModel) -> Across:
    """Both as the part of the document that the host reads."""
    stage = stage_of(width.polynomial, estimates_of(width.polynomial, ("ln_width",)))
    first, exponent = map(float, place.spread)
    return Across(LEVEL, stage, floats(width.spread), place.stretch, (first, exponent))
