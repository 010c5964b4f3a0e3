"""The two stages: what the press tells about the tissue, and with it what the stroke tells about the lump."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.regression.any_tissue.observed import TRUTH, ObservedInTissue
from palpate.regression.conformal import Widths, calibrate, fit_sigma, out_of_fold
from palpate.regression.field.model import even_odds
from palpate.regression.field.recipe import CUBIC, FIELD_FEATURES
from palpate.regression.observed import NAMES
from palpate.regression.probe_model import HARD_BELOW, Polynomial, fit_polynomial, standardised
from palpate.regression.ridge import Term, all_terms, fit_ridge, importance, monomials

OUTPUTS = ("ln d", "ln depth", "ln t", "E^-2/3", "ln F/E_fat", "ln F", "ln E_fat")
STIFFNESS = OUTPUTS.index("E^-2/3")
SCALE_FREE = tuple(n for n in FIELD_FEATURES if n not in ("ln_force", "ln_base"))
"""What does not change when all moduli and the force do; ln_base less ln_force is the twentieth."""

PRESS_TERMS, STROKE_TERMS, FOLDS, GROUPS = 120, 340, 4, 4
_PRESS = tuple(f"press_{k}" for k in range(9))
_STROKE = (*SCALE_FREE, "base_share")
_ESTIMATES = ("ln_reach", "ln_t", "ln_layers")
_CUBIC = tuple(n for n in CUBIC if n in SCALE_FREE)
"""What may be multiplied by two others, with `base_share` and the press's estimates."""


@dataclass(frozen=True)
class TissueAnswers:
    """y, half : (n, outputs), estimates and half-widths by `OUTPUTS`; hard : (n), whether a lump is called
    hard."""

    y: Floats
    half: Floats
    hard: NDArray[np.bool_]


@dataclass(frozen=True)
class TissueModel:
    """`press` estimates ln F/E_fat, ln t and ln(t + gland/ratio); `stroke` takes these three too.

    `with_press` false: the second stage has the stroke alone; with it `press` is not used.
    """

    press: Polynomial
    stroke: Polynomial
    widths: Widths
    border: float
    with_press: bool

    def answer(self, seen: ObservedInTissue, tissue: Floats | None = None) -> TissueAnswers:
        """Estimates of every stroke; tissue (n, 3): what stands in the first stage's place."""
        if tissue is None and self.with_press:
            tissue = self.press.predict(seen.press)
        X = _inputs(seen, tissue)
        y = self.stroke.predict(X)
        hard = y[:, STIFFNESS] < self.border
        return TissueAnswers(y, self.widths.half(self.stroke.standard(X), y, hard), hard)


def _inputs(seen: ObservedInTissue, estimates: Floats | None) -> Floats:
    x = seen.X[:, [NAMES.index(name) for name in SCALE_FREE]]
    base, force = (seen.X[:, NAMES.index(name)] for name in ("ln_base", "ln_force"))
    parts = [x, base - force] if estimates is None else [x, base - force, estimates]
    return np.column_stack([*parts, force])


def truth(seen: ObservedInTissue) -> Floats:
    """(n, outputs), by `OUTPUTS`."""
    return seen.Y[:, : len(OUTPUTS)]


def tissue_truth(seen: ObservedInTissue) -> Floats:
    """(n, 3): ln F/E_fat, ln t and ln(t + gland/ratio), the layers as thick as fat that gives as much."""
    ratio, gland = (seen.Y[:, TRUTH.index(name)] for name in ("gland_ratio", "gland_mm"))
    ln_t = seen.Y[:, TRUTH.index("ln t")]
    return np.column_stack([seen.Y[:, TRUTH.index("ln F/E_fat")], ln_t, np.log(np.exp(ln_t) + gland / ratio)])


def best_terms(
    X: Floats, Y: Floats, groups: NDArray[np.int64], terms: tuple[Term, ...], most: int
) -> tuple[Term, ...]:
    """The `most` of these terms worth most, all of degree one among them.

    X (n, features), Y (n, outputs), groups (n): which lump."""
    if len(terms) <= most:
        return terms
    A, degrees = monomials(standardised(X), terms), [len(t) for t in terms]
    y = (Y - Y.mean(0)) / Y.std(0)
    worth = importance(A, degrees, fit_ridge(A, y, degrees, groups))
    worth[[k for k, term in enumerate(terms) if len(term) < 2]] = np.inf
    return tuple(terms[k] for k in np.sort(np.argsort(-worth, kind="stable")[:most]))


def _fit(
    names: tuple[str, ...], X: Floats, Y: Floats, groups: NDArray[np.int64], terms: tuple[Term, ...]
) -> Polynomial:
    return fit_polynomial(names, X, Y, groups, terms, Y.min(0), Y.max(0))


def _candidates(names: tuple[str, ...]) -> tuple[Term, ...]:
    """All terms up to degree two of all features but the last, some of degree three, and that alone: ln F.

    Where moduli and forces scale together only F and E_fat change, and both go as the force.
    """
    last = len(names) - 1
    among = {names.index(name) for name in (*_CUBIC, "base_share", *_ESTIMATES) if name in names}
    cubic = tuple(t for t in combinations_with_replacement(sorted(among), 3))
    return (*all_terms(last, 2), *cubic, (last,))


def fit_press(train: ObservedInTissue) -> tuple[Polynomial, Floats]:
    """The first stage, and what it says of each stroke where it has not seen its lump (n, 3)."""
    T = tissue_truth(train)
    terms = best_terms(train.press, T, train.group, all_terms(train.press.shape[1], 3), PRESS_TERMS)

    def fit(x: Floats, y: Floats, g: NDArray[np.int64]) -> Callable[[Floats], Floats]:
        return _fit(_PRESS, x, y, g, terms).predict

    guessed = out_of_fold(train.press, T, train.group, fit, FOLDS)
    return _fit(_PRESS, train.press, T, train.group, terms), guessed


def fit_tissue_model(
    train: ObservedInTissue, with_press: bool = True, step: Callable[[str], None] | None = None
) -> TissueModel:
    """Fit both stages; strokes that show no lump are left out of the second."""
    step = step or (lambda what: None)
    # The second stage learns from estimates as good as those it will get: of lumps left out.
    press, guessed = fit_press(train)
    step("press")
    found = train.take(train.found)
    X = _inputs(found, guessed[train.found] if with_press else None)
    names = (*_STROKE, *(_ESTIMATES if with_press else ()), "ln_force")
    Y = truth(found)
    chosen = best_terms(X, Y, found.group, _candidates(names), STROKE_TERMS)

    def second(x: Floats, y: Floats, g: NDArray[np.int64]) -> Callable[[Floats], Floats]:
        return _fit(names, x, y, g, chosen).predict

    stroke = _fit(names, X, Y, found.group, chosen)
    guess = out_of_fold(X, Y, found.group, second, FOLDS)
    z = stroke.standard(X)
    sigma_terms, sigma = fit_sigma(z, guess, Y - guess, found.group)
    border = even_odds(guess[:, STIFFNESS], Y[:, STIFFNESS] <= HARD_BELOW)
    hard = guess[:, STIFFNESS] < border
    widths = calibrate(sigma_terms, sigma, z, guess, Y, hard, groups=list(quarters(found).values()))
    step("stroke")
    return TissueModel(press, stroke, widths, border, with_press)


def quarters(seen: ObservedInTissue) -> dict[str, NDArray[np.bool_]]:
    """Each quarter of d, depth, E^-2/3, F, E_fat, ratio and gland depth, by name."""
    out: dict[str, NDArray[np.bool_]] = {}
    for name in ("ln d", "ln depth", "E^-2/3", "ln F", "ln E_fat", "gland_ratio", "gland_mm"):
        values = seen.Y[:, TRUTH.index(name)]
        which = np.searchsorted(np.quantile(values, [0.25, 0.5, 0.75]), values, side="right")
        out |= {f"{name.removeprefix('ln ')}, quarter {k + 1}": which == k for k in range(GROUPS)}
    return out
