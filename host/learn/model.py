"""A model of any scope, fitted to strokes as the probe observes them: estimates, intervals, domain, checks.

Where the scope has a press there are two stages: what the press tells about the tissue, and with it what the
stroke tells about the lump.

Order of work: the first stage; the terms and the polynomial; then, on estimates of each lump by models fitted
without it, the size of residuals, the intervals' widths and the domain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import statsmodels.api as sm
from numpy.typing import NDArray

from palpate.features import press_features
from palpate.features.map_features import Floats
from palpate.learn.checks import above_zero
from palpate.learn.conformal import LEVEL, Widths, calibrate, fit_sigma, out_of_fold
from palpate.learn.domain import DomainCheck, fit_domain, with_ranges
from palpate.learn.lumps import LumpStrokes
from palpate.learn.observed import NAMES, Observed, joined, random_scale
from palpate.learn.probe_model import (
    E_INV23,
    HARD_BELOW,
    OUTPUTS,
    Polynomial,
    estimates_of,
    features_version,
    fit_polynomial,
    spec_of,
    stage_of,
    standardised,
)
from palpate.learn.ridge import Term, all_terms
from palpate.learn.scopes import BORDER, ESTIMATES, PRESS, Scope, most_worth
from palpate.model_export.integers import force_map as force_maps
from palpate.model_export.integers.reference import with_checks
from palpate.model_export.schema import FirstStage, Joining, ModelSpec
from palpate.sim.tissue import Stroke
from palpate.spans import depth_mm as depth_span

FLAGGED_INSIDE, UNFAMILIAR_INSIDE = 0.022, 0.002
"""Shares of strokes inside the ranges that are flagged without the checks: in all, by box and distance
alone."""
NEAR_THE_BORDER, FEWEST_ON_A_SIDE = 0.1, 50
"""Estimates of E^-2/3 this close to hard or soft, and this many on either side, place the border."""
PRESS_TERMS, PRESS_DEGREE = 50, 3
_OF_DEPTH = OUTPUTS.index("ln d"), OUTPUTS.index("ln h")
"""The depth's interval follows from theirs (`palpate.spans`): wider for one alone, they would contradict
each other."""
_WIDER_H = (1.0, 1.025, 1.05, 1.075, 1.1)


@dataclass(frozen=True)
class Answers:
    """A model's answers for n strokes, as the probe gives them.

    y, half : (n, outputs), link scale; hard : (n), called hard; familiar : (n), in the domain but for the
    checks; unlike : (n), left out by a check.
    """

    y: Floats
    half: Floats
    hard: NDArray[np.bool_]
    familiar: NDArray[np.bool_]
    unlike: NDArray[np.bool_]

    @property
    def in_domain(self) -> NDArray[np.bool_]:
        """(n), whether each stroke is one that the model is for."""
        return self.familiar & ~self.unlike


@dataclass(frozen=True)
class FittedModel:
    """A fitted model; `border` is the estimate of E^-2/3 below which a lump counts as hard.

    `press` estimates `scopes.ESTIMATES`, and `polynomial` takes these three too; None: it has the stroke
    alone, or is told its tissue, with fat of `fat_kPa`.
    """

    scope: Scope
    press: Polynomial | None
    polynomial: Polynomial
    widths: Widths
    domain: DomainCheck
    border: float = HARD_BELOW
    checks: FirstStage | None = None
    fat_kPa: float = 10.0

    def inputs(self, seen: Observed, tissue: Floats | None = None) -> Floats:
        """The last stage's features, (n, features); tissue (n, 3): what stands in the first stage's place."""
        if tissue is None and self.press is not None:
            tissue = said_by_press(self.press, seen.press)
        return inputs_of(self.polynomial.names, seen, tissue)

    def answer(self, seen: Observed, tissue: Floats | None = None) -> Answers:
        """Estimates of every stroke, those without a lump too (their numbers mean nothing)."""
        X = self.inputs(seen, tissue)
        z, y = self.polynomial.standard(X), self.polynomial.predict(X)
        hard = y[:, E_INV23] < self.border
        half = self.widths.half(z, y, hard)
        return Answers(y, half, hard, self.domain.inside(X, z, y, half), self.unlike(X, seen))

    def unlike(self, X: Floats, seen: Observed) -> NDArray[np.bool_]:
        """Whether a check is above 0 for each stroke, (n); X as of `inputs`."""
        if self.checks is None:
            return np.zeros(len(X), bool)
        names = self.polynomial.names
        more = [name for name in self.checks.features if name not in names]
        return above_zero(self.checks, (*names, *more), np.hstack([X, seen.features(more)]))

    def spec(
        self,
        training: dict[str, Any],
        force_map: dict[str, Any] | None,
        joining: Joining | None = None,
        **parts: Any,
    ) -> ModelSpec:
        """The document that `palpate export` compiles; parts: `across`, `layers` (the host's), notes."""
        host = {name: parts.pop(name) for name in ("across", "layers") if name in parts}
        first = (
            None if self.press is None else stage_of(self.press, estimates_of(self.press, ESTIMATES), joining)
        )
        spec = spec_of(
            "field",
            self.polynomial,
            self.widths,
            self.domain,
            self.scope.force_N_per_m,
            training,
            force_map,
            parts,
            hard_below=self.border,
            fat_kPa=self.fat_kPa if self.scope.told else None,
            first=first,
        )
        names = [name for name in with_checks(self.polynomial.names, self.checks) if name in NAMES]
        version = max(spec.features_version, features_version(names))
        return replace(spec, checks=self.checks, features_version=version, **host).validate()


def inputs_of(names: Sequence[str], seen: Observed, estimates: Floats | None) -> Floats:
    """Features of the last stage, (n, names): the firmware's, and the first stage's estimates (n, 3)."""
    of = {} if estimates is None else dict(zip(ESTIMATES, estimates.T, strict=True))
    return np.column_stack([of[n] if n in of else seen.X[:, NAMES.index(n)] for n in names])


def said_by_press(press: Polynomial, X: Floats) -> Floats:
    """The first stage's estimates, (n, 3), from features X (n, 12), by `press_features.NAMES`."""
    return press.predict(press_features.named(X, press.names))


def tissue_truth(seen: Observed) -> Floats:
    """(n, 3): ln F/E_fat, ln t and ln(t + gland/ratio), the layers as thick as fat that gives as much."""
    ln_t = seen.of("ln t")
    layers = np.exp(ln_t) + seen.of("gland_mm") / seen.of("gland_ratio")
    return np.column_stack([seen.of("ln F/E_fat"), ln_t, np.log(layers)])


def learn_force_map(lumps: Sequence[LumpStrokes], displacement: bool = True) -> force_maps.ForceMap:
    """The map that moves a frame to another force, from the outer strokes of training lumps.

    Images are rows, or whole faces, whose columns' mean then counts.
    """
    low, high = ([getattr(lump, end).full() for lump in lumps] for end in ("low", "high"))
    return force_maps.fit(
        np.concatenate([_rows(s) for s in low]),
        np.concatenate([s.displacement_mm for s in low]),
        np.concatenate([_rows(s) for s in high]),
        np.concatenate([s.displacement_mm for s in high]),
        displacement=displacement,
    )


def force_map_in_any_fat(lumps: Sequence[LumpStrokes]) -> force_maps.ForceMap:
    """The map that moves frames to another force, learnt over every fat at once; of solid lumps too."""
    fats = (random_scale(lump.case, np.random.default_rng(k)) for k, lump in enumerate(lumps))
    return learn_force_map([replace(lump, press=()).scaled(s) for lump, s in zip(lumps, fats)])


def _rows(stroke: Stroke) -> Floats:
    """What its rows feel (n, 16)."""
    return stroke.images_kPa if stroke.images_kPa.ndim == 2 else stroke.images_kPa.mean(2)


def fit_press(train: Observed, names: tuple[str, ...] = PRESS) -> tuple[Polynomial, Floats]:
    """The first stage of these features, and what it says of each stroke where it has not seen its lump
    (n, 3)."""
    T, X, groups = tissue_truth(train), press_features.named(train.press, names), train.group
    terms = most_worth(all_terms(len(names), PRESS_DEGREE), PRESS_TERMS, 1, standardised(X), T, groups)
    return _fitted(names, X, T, groups, terms, BORDER)


def _fitted(
    names: tuple[str, ...],
    X: Floats,
    Y: Floats,
    groups: NDArray[np.int64],
    terms: tuple[Term, ...],
    scope: Scope,
) -> tuple[Polynomial, Floats]:
    """The polynomial, and what it says of each stroke where it has not seen its lump (n, outputs)."""

    def fit(x: Floats, y: Floats, g: NDArray[np.int64]) -> Polynomial:
        lo, hi = (y.min(0), y.max(0)) if scope.ends is None else np.array([*scope.ends.values()]).T
        return fit_polynomial(names, x, y, g, terms, lo, hi)

    guess = out_of_fold(X, Y, groups, lambda x, y, g: fit(x, y, g).predict, scope.folds)
    return fit(X, Y, groups), guess


def fit_model(scope: Scope, train: Observed, rim: Observed | None = None) -> FittedModel:
    """Fit the model of a scope; strokes that show no lump are left out of its last stage.

    Parameters
    ----------
    scope : Scope
    train : Observed
    rim : Observed, optional
        Strokes over lumps just outside the ranges: polynomials are fitted to them too, so that they do not
        extrapolate at the ranges' corners; intervals and domain are not.
    """
    n = len(train)
    if rim is not None and len(rim):
        train = joined([train, replace(rim, group=-1 - rim.group)])
    press, guessed = None, None
    if scope.press:
        # The last stage learns from estimates as good as it will get: of lumps left out.
        press, guessed = fit_press(train, scope.press)
        guessed = guessed[train.found]
    within = int(train.found[:n].sum())
    found, recipe = train.take(train.found), scope.last_stage
    X, Y = inputs_of(recipe.features, found, guessed), found.truth[:, : scope.estimated]
    terms = recipe.terms(standardised(X), Y, found.group)
    polynomial, guess = _fitted(recipe.features, X, Y, found.group, terms, scope)
    # From here on the model's own lumps, each as it is estimated without itself.
    own, x, y, true = found.take(np.arange(within)), X[:within], guess[:within], Y[:within]
    z = polynomial.standard(x)
    sigma = fit_sigma(z, y, true - y, own.group)
    border = even_odds(y[:, E_INV23], true[:, E_INV23] <= HARD_BELOW)
    hard = y[:, E_INV23] < border
    widths = calibrate(*sigma, z, y, true, hard, groups=list(scope.parts(own).values()), together=[_OF_DEPTH])
    widths = _wide_enough_for_depth(widths, z, y, true, hard)
    domain = with_ranges(
        fit_domain(x, z, scope.estimated, UNFAMILIAR_INSIDE),
        np.array([scope.limits(name)[0] for name in OUTPUTS[: scope.estimated]]),
        np.array([scope.limits(name)[1] for name in OUTPUTS[: scope.estimated]]),
        familiar_unseen(polynomial, x, own.group),
        y,
        widths.half(z, y, hard),
        FLAGGED_INSIDE,
    )
    return FittedModel(scope, press, polynomial, widths, domain, border)


def familiar_unseen(model: Polynomial, X: Floats, groups: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each stroke passes a box and distance fitted without its lump, (n); with it, too many would.

    X : (n, features); groups : (n), which lump.
    """

    def fit(x: Floats, _: Floats, __: NDArray[np.int64]) -> Callable[[Floats], Floats]:
        check = fit_domain(x, model.standard(x), share_out=UNFAMILIAR_INSIDE)
        return lambda fresh: check.familiar(fresh, model.standard(fresh))[:, None].astype(float)

    return out_of_fold(X, np.ones((len(X), 1)), groups, fit)[:, 0] > 0.5


def even_odds(estimate: Floats, hard: NDArray[np.bool_]) -> float:
    """The estimate of E^-2/3 at which a lump is as likely hard as soft, by logistic regression.

    Parameters
    ----------
    estimate : (n)
        Of strokes that the model has not seen.
    hard : (n), bool
    """
    near = np.abs(estimate - HARD_BELOW) < NEAR_THE_BORDER
    x, y = estimate[near] - HARD_BELOW, hard[near]
    if min(y.sum(), (~y).sum()) < FEWEST_ON_A_SIDE:
        return HARD_BELOW
    a, b = sm.GLM(y.astype(float), sm.add_constant(x), family=sm.families.Binomial()).fit().params
    return HARD_BELOW - float(np.clip(a / b, -NEAR_THE_BORDER / 4, NEAR_THE_BORDER / 4))


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
    d, h = _OF_DEPTH
    true = np.exp(Y[:, d] + Y[:, h])
    for factor in _WIDER_H:
        quantiles = widths.quantiles.copy()
        quantiles[h] *= factor
        tried = replace(widths, quantiles=quantiles)
        _, low, high = depth_mm(y, tried.half(z, y, hard)).T
        if ((low <= true) & (true <= high)).mean() >= LEVEL:
            break
    return tried
