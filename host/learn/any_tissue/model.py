"""The two stages: what the press tells about the tissue, and with it what the stroke tells about the lump."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from palpate.features import press_features
from palpate.features.map_features import Floats
from palpate.learn.any_tissue.observed import TRUTH, ObservedInTissue, joined
from palpate.learn.conformal import LEVEL, Widths, calibrate, fit_sigma, out_of_fold
from palpate.learn.domain import DomainCheck, fit_domain, with_ranges
from palpate.learn.field.model import FLAGGED_INSIDE, UNFAMILIAR_INSIDE, even_odds, familiar_unseen
from palpate.learn.field.recipe import CUBIC
from palpate.learn.observed import NAMES
from palpate.learn.probe_model import HARD_BELOW, Polynomial, fit_polynomial, standardised
from palpate.learn.ridge import Term, all_terms, fit_ridge, importance, monomials
from palpate.spans import depth_mm as depth_span

OUTPUTS = ("ln F", "ln t", "ln d", "ln h", "E^-2/3", "ln E_fat")
"""Those of the wire (`firmware_py.outputs`), link scale."""
RANGES = {
    "ln d": (float(np.log(5.0)), float(np.log(20.0))),
    "ln h": (float(np.log(0.3)), float(np.log(1.5))),
    "E^-2/3": (-np.inf, 2.0 ** (-2 / 3)),
    "ln E_fat": (float(np.log(2.0)), float(np.log(40.0))),
}
"""What the model is for; t follows from d and h, hard lumps feel alike, the force has a flag of its own."""
Parts = dict[str, NDArray[np.bool_]]
"""Some of n strokes each, (n), by what they have in common."""
STIFFNESS = OUTPUTS.index("E^-2/3")
_OF_DEPTH = OUTPUTS.index("ln d"), OUTPUTS.index("ln h")
"""The depth's interval follows from theirs (`palpate.spans`): wider for one alone, they would contradict
each other."""
PRESS_TERMS, STROKE_TERMS, FOLDS, GROUPS = 50, 200, 4, 4
"""So many that the board has room for both stages; 120 and 340 err by a fiftieth less."""
_WIDER_H = (1.0, 1.025, 1.05, 1.075, 1.1)
PRESS = tuple(name for name in press_features.NAMES if name not in press_features.OUTER)
"""In plane strain the outer columns read what the others do."""
ESTIMATES = ("ln_reach", "ln_t", "ln_layers")
DEEPEST = "press_d_full"
"""The one of the press that the second stage has too: where there was no press it is outside the domain."""
STROKE = (
    *("asinh_amp", "ln_stdev", "dip_6_10", "ln_misfit", "trace_7_9", "trace_12_16", "dip_12_16", "ln_peak"),
    *("ln_width_far", "ln_bump", "pull_3_5", "pull_6_9", "pull_10_14", "pull_15_19", "pull_20_24"),
    *("pull_25_33", "lift_3_5", "lift_17_22", "base_share"),
)
"""Of the stroke, what does not change when all moduli and the force do: the nineteen that were left when
those worth least to held-out lumps on the border were dropped, two at a time."""
LAST = (DEEPEST, "ln_force")
ALONE = "ln_d_far"
"""How deep the probe sinks, where there is no press to say it."""
_CUBIC = (*CUBIC, "ln_bump", "pull_6_9", "pull_10_14", "base_share", *ESTIMATES)
"""What may be multiplied by two others."""


@dataclass(frozen=True)
class Scope:
    """What a model is for.

    ranges: of `OUTPUTS`, link scale; what lies beyond is outside the domain. parts: those for each of which
    the intervals are to hold. features: of the stroke, for the second stage.
    """

    ranges: Mapping[str, tuple[float, float]]
    parts: Callable[[ObservedInTissue], Parts]
    features: tuple[str, ...] = STROKE


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
    domain: DomainCheck

    def inputs(self, seen: ObservedInTissue, tissue: Floats | None = None) -> Floats:
        """The second stage's features, (n, features), by `stroke.names`; tissue as in `answer`."""
        if tissue is None and self.with_press:
            tissue = self.press.predict(press_features.named(seen.press, self.press.names))
        return _inputs(self.stroke.names, seen, tissue)

    def answer(self, seen: ObservedInTissue, tissue: Floats | None = None) -> TissueAnswers:
        """Estimates of every stroke; tissue (n, 3): what stands in the first stage's place."""
        X = self.inputs(seen, tissue)
        y = self.stroke.predict(X)
        hard = y[:, STIFFNESS] < self.border
        return TissueAnswers(y, self.widths.half(self.stroke.standard(X), y, hard), hard)

    def in_domain(self, seen: ObservedInTissue) -> NDArray[np.bool_]:
        """Whether each stroke is one that the model is for, (n)."""
        X = self.inputs(seen)
        said = self.answer(seen)
        return self.domain.inside(X, self.stroke.standard(X), said.y, said.half)


def _inputs(names: tuple[str, ...], seen: ObservedInTissue, estimates: Floats | None) -> Floats:
    """The second stage's features, by `names`: the firmware's, and the press's estimates (n, 3)."""
    of = {} if estimates is None else dict(zip(ESTIMATES, estimates.T, strict=True))
    return np.column_stack([of[n] if n in of else seen.X[:, NAMES.index(n)] for n in names])


def _input_names(of_stroke: tuple[str, ...], with_press: bool) -> tuple[str, ...]:
    """Names of the second stage's features; `_candidates` takes those behind the estimates for themselves."""
    if with_press:
        return (*of_stroke, *ESTIMATES, DEEPEST, "ln_force")
    return (*of_stroke, "ln_force") if ALONE in of_stroke else (*of_stroke, ALONE, "ln_force")


def truth(seen: ObservedInTissue) -> Floats:
    """(n, outputs), by `OUTPUTS`."""
    of = {name: seen.Y[:, k] for k, name in enumerate(TRUTH)}
    of["ln h"] = of["ln depth"] - of["ln d"]
    return np.column_stack([of[name] for name in OUTPUTS])


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
    """All terms up to degree two of most features, some of degree three; ln F and `DEEPEST` stand alone.

    Where moduli and forces scale together only F and E_fat change, and both go as the force.
    """
    alone = [k for k, name in enumerate(names) if name in LAST]
    among = {names.index(name) for name in _CUBIC if name in names and name not in LAST}
    cubic = tuple(t for t in combinations_with_replacement(sorted(among), 3))
    return (*all_terms(min(alone), 2), *cubic, *((k,) for k in alone))


def fit_press(train: ObservedInTissue, names: tuple[str, ...] = PRESS) -> tuple[Polynomial, Floats]:
    """The first stage of these features, and what it says of each stroke where it has not seen its lump
    (n, 3)."""
    T, X = tissue_truth(train), press_features.named(train.press, names)
    terms = best_terms(X, T, train.group, all_terms(len(names), 3), PRESS_TERMS)

    def fit(x: Floats, y: Floats, g: NDArray[np.int64]) -> Callable[[Floats], Floats]:
        return _fit(names, x, y, g, terms).predict

    guessed = out_of_fold(X, T, train.group, fit, FOLDS)
    return _fit(names, X, T, train.group, terms), guessed


def fit_tissue_model(
    train: ObservedInTissue,
    with_press: bool = True,
    rim: ObservedInTissue | None = None,
    step: Callable[[str], None] | None = None,
    press_names: tuple[str, ...] = PRESS,
    scope: Scope | None = None,
) -> TissueModel:
    """Fit both stages; strokes that show no lump are left out of the second.

    `rim`: strokes over lumps just outside the ranges, for the polynomials alone (see `field.model`).
    `press_names`: the first stage's features. `scope`: by default `ON_BORDER`.
    """
    step, scope = step or (lambda what: None), scope or ON_BORDER
    within = len(train.X)
    if rim is not None:
        train = joined([train, replace(rim, group=-1 - rim.group)])
    # The second stage learns from estimates as good as those it will get: of lumps left out.
    press, guessed = fit_press(train, press_names)
    step("press")
    within = int(train.found[:within].sum())
    found = train.take(train.found)
    names = _input_names(scope.features, with_press)
    X = _inputs(names, found, guessed[train.found] if with_press else None)
    Y = truth(found)
    chosen = best_terms(X, Y, found.group, _candidates(names), STROKE_TERMS)

    def second(x: Floats, y: Floats, g: NDArray[np.int64]) -> Callable[[Floats], Floats]:
        return _fit(names, x, y, g, chosen).predict

    stroke = _fit(names, X, Y, found.group, chosen)
    guess = out_of_fold(X, Y, found.group, second, FOLDS)[:within]
    X, Y, found = X[:within], Y[:within], found.take(np.arange(within))
    z = stroke.standard(X)
    sigma_terms, sigma = fit_sigma(z, guess, Y - guess, found.group)
    border = even_odds(guess[:, STIFFNESS], Y[:, STIFFNESS] <= HARD_BELOW)
    hard = guess[:, STIFFNESS] < border
    parts = list(scope.parts(found).values())
    widths = calibrate(sigma_terms, sigma, z, guess, Y, hard, groups=parts, together=[_OF_DEPTH])
    widths = _wide_enough_for_depth(widths, z, guess, Y, hard)
    step("stroke")
    domain = _domain(stroke, X, z, guess, widths.half(z, guess, hard), found.group, scope)
    return TissueModel(press, stroke, widths, border, with_press, domain)


def depth_mm(y: Floats, half: Floats) -> Floats:
    """Fat over the lump, which follows from t, d and h: value, low and high, (n, 3)."""
    t, d, h = (OUTPUTS.index(name) for name in ("ln t", "ln d", "ln h"))
    spans = np.exp(np.stack([y, y - half, y + half], axis=2))
    return np.array([depth_span(*map(tuple, stroke[[t, d, h]])) for stroke in spans])


def _wide_enough_for_depth(
    widths: Widths, z: Floats, y: Floats, Y: Floats, hard: NDArray[np.bool_]
) -> Widths:
    """The same with h's intervals a little wider, where the depth's would hold too seldom.

    The depth has no output of its own; how its interval follows tells h's most of all (`depth_mm`).
    """
    d, h = (OUTPUTS.index(name) for name in ("ln d", "ln h"))
    true = np.exp(Y[:, d] + Y[:, h])
    for factor in _WIDER_H:
        quantiles = widths.quantiles.copy()
        quantiles[h] *= factor
        tried = replace(widths, quantiles=quantiles)
        _, low, high = depth_mm(y, tried.half(z, y, hard)).T
        if ((low <= true) & (true <= high)).mean() >= LEVEL:
            break
    return tried


def _domain(
    stroke: Polynomial,
    X: Floats,
    z: Floats,
    y: Floats,
    half: Floats,
    groups: NDArray[np.int64],
    scope: Scope,
) -> DomainCheck:
    """Box, distance and ranges that leave out `FLAGGED_INSIDE` of strokes like these."""
    ends = np.array([scope.ranges.get(name, (-np.inf, np.inf)) for name in OUTPUTS]).T
    domain = fit_domain(X, z, len(OUTPUTS), UNFAMILIAR_INSIDE)
    familiar = familiar_unseen(stroke, X, groups)
    return with_ranges(domain, ends[0], ends[1], familiar, y, half, FLAGGED_INSIDE)


def quarters(seen: ObservedInTissue) -> Parts:
    """Each quarter of d, depth, E^-2/3, F, E_fat, ratio and gland depth, by name."""
    out: Parts = {}
    for name in ("ln d", "ln depth", "E^-2/3", "ln F", "ln E_fat", "gland_ratio", "gland_mm"):
        values = seen.Y[:, TRUTH.index(name)]
        which = np.searchsorted(np.quantile(values, [0.25, 0.5, 0.75]), values, side="right")
        out |= {f"{name.removeprefix('ln ')}, quarter {k + 1}": which == k for k in range(GROUPS)}
    return out


ON_BORDER = Scope(RANGES, quarters)
"""Lumps on the border between fat and gland."""
