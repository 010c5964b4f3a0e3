"""What a stroke over a solid lump tells, with its press: as `any_tissue.model`, and across the stroke too.

Only so many terms are used as there are lumps to tell them apart; a larger set brings a richer model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.regression.any_tissue.model import SCALE_FREE, TissueAnswers, best_terms
from palpate.regression.balls.observed import TRUTH, ObservedBalls
from palpate.regression.conformal import LEVEL, Widths, calibrate, fit_sigma, out_of_fold
from palpate.regression.field.model import even_odds
from palpate.regression.observed import NAMES
from palpate.regression.probe_model import HARD_BELOW, Polynomial, fit_polynomial
from palpate.regression.ridge import Term, all_terms

OUTPUTS = TRUTH[:9]
STIFFNESS = OUTPUTS.index("E^-2/3")
GROUPS = 4
SOME, MANY = 100, 300
"""Lumps from which on products of two inputs are used, and every scale-free feature."""

_PRESS_TERMS = 120
_ROOM = np.where(np.array(OUTPUTS) == "offset", 5.0, 0.0)
"""How far estimates may go beyond what was seen: held at an offset of 0 they would seem to have no error."""

_SIDE = ("ln_width_across", "place_across", "share_across", "columns")
_ESTIMATES = ("ln_reach", "ln_t", "ln_layers")
_FEW = ("asinh_amp", "ln_stdev", "dip_6_10", "ln_d_far", "trace_7_9")
_STRENGTHS = 10.0 ** np.arange(-8.0, 2.1, 0.5)
"""Few lumps may need a stronger ridge than thousands."""


@dataclass(frozen=True)
class BallModel:
    """`press` estimates ln F/E_fat, ln t and ln(t + gland/ratio); `stroke` takes these three too.

    `features` are the firmware's; `with_press` false: the second stage has the stroke alone.
    """

    features: tuple[str, ...]
    press: Polynomial
    stroke: Polynomial
    widths: Widths
    border: float
    with_press: bool

    def answer(self, seen: ObservedBalls) -> TissueAnswers:
        """Estimates of every stroke."""
        estimates = self.press.predict(seen.press) if self.with_press else None
        X = _inputs(seen, self.features, estimates)
        y = self.stroke.predict(X)
        hard = y[:, STIFFNESS] < self.border
        return TissueAnswers(y, self.widths.half(self.stroke.standard(X), y, hard), hard)


def _inputs(seen: ObservedBalls, features: tuple[str, ...], estimates: Floats | None) -> Floats:
    x = seen.X[:, [NAMES.index(name) for name in features]]
    base, force = (seen.X[:, NAMES.index(name)] for name in ("ln_base", "ln_force"))
    told = [] if estimates is None else [estimates]
    return np.column_stack([x, base - force, seen.side, *told, force])


def truth(seen: ObservedBalls) -> Floats:
    """(n, outputs), by `OUTPUTS`."""
    return seen.Y[:, : len(OUTPUTS)]


def tissue_truth(seen: ObservedBalls) -> Floats:
    """(n, 3): ln F/E_fat, ln t and ln(t + gland/ratio), the layers as thick as fat that gives as much."""
    ln_t = seen.truth("ln t")
    layers = np.exp(ln_t) + seen.truth("gland_mm") / seen.truth("gland_ratio")
    return np.column_stack([seen.truth("ln F/E_fat"), ln_t, np.log(layers)])


def fit_ball_model(train: ObservedBalls, with_press: bool = True) -> BallModel:
    """Fit both stages; strokes that show no lump are left out of the second."""
    lumps = len(np.unique(train.group))
    T = tissue_truth(train)
    among = all_terms(train.press.shape[1], _degree(lumps) + 1)
    press_terms = best_terms(train.press, T, train.group, among, min(_PRESS_TERMS, lumps))
    press_names = tuple(f"press_{k}" for k in range(train.press.shape[1]))

    def first(x: Floats, y: Floats, g: NDArray[np.int64]) -> Callable[[Floats], Floats]:
        return _fit(press_names, x, y, g, press_terms).predict

    # The second stage learns from estimates as good as those it will get: of lumps left out.
    guessed = out_of_fold(train.press, T, train.group, first)
    press = _fit(press_names, train.press, T, train.group, press_terms)

    found = train.take(train.found)
    features = SCALE_FREE if lumps >= MANY else _FEW
    X, Y = _inputs(found, features, guessed[train.found] if with_press else None), truth(found)
    names = (*features, "base_share", *_SIDE, *(_ESTIMATES if with_press else ()), "ln_force")
    terms = _terms(X, Y, found.group)

    def second(x: Floats, y: Floats, g: NDArray[np.int64]) -> Callable[[Floats], Floats]:
        return _fit(names, x, y, g, terms, _ROOM).predict

    stroke = _fit(names, X, Y, found.group, terms, _ROOM)
    guess = out_of_fold(X, Y, found.group, second)
    z = stroke.standard(X)
    sigma_terms, sigma = fit_sigma(z, guess, Y - guess, found.group, 0 if lumps < SOME else 1)
    border = even_odds(guess[:, STIFFNESS], Y[:, STIFFNESS] <= HARD_BELOW)
    hard = guess[:, STIFFNESS] < border
    # Strokes over one lump err alike: it is lumps that the quantile has to count.
    level = min(1.0, LEVEL * (1 + 1 / lumps))
    widths = calibrate(sigma_terms, sigma, z, guess, Y, hard, level, groups=list(quarters(found).values()))
    return BallModel(features, press, stroke, widths, border, with_press)


def _terms(X: Floats, Y: Floats, groups: NDArray[np.int64]) -> tuple[Term, ...]:
    """Squares and products, if there are lumps enough, of all inputs but the last, ln F, which stands
    alone: where moduli and forces scale together only F and E_fat change, and both go as the force."""
    inputs = X.shape[1] - 1
    lumps = len(np.unique(groups))
    most = max(lumps, inputs + 1)
    return (*best_terms(X[:, :-1], Y, groups, all_terms(inputs, _degree(lumps)), most), (inputs,))


def _degree(lumps: int) -> int:
    return 1 if lumps < SOME else 2


def _fit(
    names: tuple[str, ...],
    X: Floats,
    Y: Floats,
    groups: NDArray[np.int64],
    terms: tuple[Term, ...],
    room: Floats | float = 0.0,
) -> Polynomial:
    return fit_polynomial(names, X, Y, groups, terms, Y.min(0) - room, Y.max(0) + room, _STRENGTHS)


def quarters(seen: ObservedBalls) -> dict[str, NDArray[np.bool_]]:
    """Each quarter of d, depth, E^-2/3, F and E_fat, by name."""
    out: dict[str, NDArray[np.bool_]] = {}
    for name in ("ln d", "ln depth", "E^-2/3", "ln F", "ln E_fat"):
        values = seen.truth(name)
        which = np.searchsorted(np.quantile(values, [0.25, 0.5, 0.75]), values, side="right")
        out |= {f"{name.removeprefix('ln ')}, quarter {k + 1}": which == k for k in range(GROUPS)}
    return out
