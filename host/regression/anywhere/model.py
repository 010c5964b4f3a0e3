"""A model of lumps that lie anywhere: its two stages are those of `any_tissue`, and it says the place too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import erf

import numpy as np
from numpy.typing import NDArray

from palpate.features import press_features
from palpate.features.map_features import Floats
from palpate.regression.any_tissue.model import SCALE_FREE, best_terms, fit_press
from palpate.regression.any_tissue.observed import TRUTH, ObservedInTissue
from palpate.regression.conformal import Widths, calibrate, fit_sigma, out_of_fold
from palpate.regression.field.model import even_odds
from palpate.regression.field.recipe import CUBIC
from palpate.regression.observed import NAMES
from palpate.regression.probe_model import HARD_BELOW, Polynomial, fit_polynomial
from palpate.regression.ridge import Term, all_terms

OUTPUTS = ("ln d", "ln depth", "ln t", "E^-2/3", "ln E_fat", "in the fat")
"""The last: how much of the lump's height lies in the fat, from -1 (a diameter under it) to 2."""

STIFFNESS, SHARE = OUTPUTS.index("E^-2/3"), OUTPUTS.index("in the fat")
PLACES = ("in the fat", "at the border", "in the gland", "unsure")
FAT, BORDER, GLAND, UNSURE = range(4)
SURE = 0.8
"""A place is said where its probability is at least this."""

TERMS, FOLDS = 340, 4
_FARTHEST = (-1.0, 2.0)
_FEATURES = (*SCALE_FREE, "base_share", "ln_reach", "ln_t", "ln_layers", "ln_force")
_CUBED = (*(n for n in CUBIC if n in SCALE_FREE), "base_share", "ln_reach", "ln_t", "ln_layers")
_SD_OF_HALF = 1.645


@dataclass(frozen=True)
class AnywhereAnswers:
    """y, half : (n, outputs), by `OUTPUTS`; hard : (n), bool; place : (n), of `PLACES`."""

    y: Floats
    half: Floats
    hard: NDArray[np.bool_]

    @property
    def place(self) -> NDArray[np.int64]:
        """Where each lump is said to lie, (n)."""
        share, sd = self.y[:, SHARE], self.half[:, SHARE] / _SD_OF_HALF
        fat, over = _normal((share - 1) / sd), _normal(share / sd)
        odds = np.stack([fat, over - fat, 1 - over], 1)
        return np.where(odds.max(1) < SURE, UNSURE, odds.argmax(1))


@dataclass(frozen=True)
class AnywhereModel:
    """`press` tells the tissue, `lump` what lies in it; `widths` and `border` as in `any_tissue`."""

    press: Polynomial
    lump: Polynomial
    widths: Widths
    border: float

    def answer(self, seen: ObservedInTissue) -> AnywhereAnswers:
        """Estimates of every stroke."""
        X = _inputs(seen, self.press.predict(press_features.named(seen.press, self.press.names)))
        y = self.lump.predict(X)
        hard = y[:, STIFFNESS] < self.border
        return AnywhereAnswers(y, self.widths.half(self.lump.standard(X), y, hard), hard)


def _normal(z: Floats) -> Floats:
    """Share of the normal distribution below z."""
    return 0.5 * (1 + np.vectorize(erf)(z / np.sqrt(2)))


def truth(seen: ObservedInTissue) -> Floats:
    """(n, outputs), by `OUTPUTS`."""
    of = {name: seen.Y[:, k] for k, name in enumerate(TRUTH)}
    of["in the fat"] = np.clip(share_in_fat(seen), *_FARTHEST)
    return np.column_stack([of[name] for name in OUTPUTS])


def share_in_fat(seen: ObservedInTissue) -> Floats:
    """(t - depth) / d, (n): 1 and more wholly in the fat, 0 and less wholly in the gland."""
    d, depth, t = (np.exp(seen.Y[:, TRUTH.index(name)]) for name in ("ln d", "ln depth", "ln t"))
    return (t - depth) / d


def true_place(seen: ObservedInTissue) -> NDArray[np.int64]:
    """Where each lump lies, (n), of `PLACES`."""
    share = share_in_fat(seen)
    return np.where(share >= 1, FAT, np.where(share <= 0, GLAND, BORDER))


def _inputs(seen: ObservedInTissue, tissue: Floats) -> Floats:
    x = seen.X[:, [NAMES.index(name) for name in SCALE_FREE]]
    base, force = (seen.X[:, NAMES.index(name)] for name in ("ln_base", "ln_force"))
    return np.column_stack([x, base - force, tissue, force])


def _candidates() -> tuple[Term, ...]:
    """Degree two, some of degree three, and ln F alone: with the moduli it scales E_fat and nothing else."""
    last = len(_FEATURES) - 1
    cubed = combinations_with_replacement([_FEATURES.index(name) for name in _CUBED], 3)
    return (*all_terms(last, 2), *cubed, (last,))


def fit_anywhere(train: ObservedInTissue) -> AnywhereModel:
    """Fit both stages and the intervals; strokes that show no lump are left out of the second."""
    press, guessed = fit_press(train)
    found = train.take(train.found)
    X, Y = _inputs(found, guessed[train.found]), truth(found)
    terms = best_terms(X, Y, found.group, _candidates(), TERMS)

    def fit(x: Floats, y: Floats, g: NDArray[np.int64]) -> Polynomial:
        return fit_polynomial(_FEATURES, x, y, g, terms, Y.min(0), Y.max(0))

    def predictor(x: Floats, y: Floats, g: NDArray[np.int64]) -> Callable[[Floats], Floats]:
        return fit(x, y, g).predict

    lump = fit(X, Y, found.group)
    guess = out_of_fold(X, Y, found.group, predictor, FOLDS)
    z = lump.standard(X)
    sigma_terms, sigma = fit_sigma(z, guess, Y - guess, found.group)
    border = even_odds(guess[:, STIFFNESS], Y[:, STIFFNESS] <= HARD_BELOW)
    hard = guess[:, STIFFNESS] < border
    places = [true_place(found) == place for place in (FAT, BORDER, GLAND)]
    widths = calibrate(sigma_terms, sigma, z, guess, Y, hard, groups=places)
    return AnywhereModel(press, lump, widths, border)
