"""The field model: fitted to strokes as the probe observes them, with intervals, domain and lump rule.

Order of work: the force map and the polynomial on training lumps, the size of residuals on out-of-fold
predictions of these, quantiles on both these and calibration lumps, the domain on all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import statsmodels.api as sm
from numpy.typing import NDArray

from firmware_py import outputs
from palpate.features.map_features import Floats
from palpate.learn.checks import above_zero
from palpate.learn.conformal import Widths, calibrate, fit_sigma, out_of_fold
from palpate.learn.domain import DomainCheck, fit_domain, with_ranges
from palpate.learn.field.design import LumpStrokes
from palpate.learn.field.recipe import Recipe
from palpate.learn.observed import NAMES, ObservedStrokes, join
from palpate.learn.probe_model import (
    E_INV23,
    HARD_BELOW,
    LEAST_AMP_SHARE,
    Polynomial,
    features_version,
    fit_polynomial,
    from_link,
    shows_lump,
    spec_of,
    standardised,
    to_link,
    training_hash,
)
from palpate.model_export.fixed_point import force_map as force_maps
from palpate.model_export.fixed_point.reference import with_checks
from palpate.model_export.schema import FirstStage, ModelSpec
from palpate.sim.tissue import Stroke

RANGE_LO, RANGE_HI, LOWEST, HIGHEST = (
    tuple(float(row[k]) for row in outputs.TABLE[: outputs.E_FAT]) for k in range(4, 8)
)
"""What the model is for, and where its estimates are held; see `firmware_py.outputs`."""

FitChecks = Callable[[ObservedStrokes], FirstStage | None]

FLAGGED_INSIDE, UNFAMILIAR_INSIDE, WITH_CHECKS = 0.022, 0.002, 0.025
"""Shares of calibration strokes out of the domain: in all, by box and distance alone, and in all where the
model has checks."""

NEAR_THE_BORDER, FEWEST_ON_A_SIDE = 0.1, 50
"""Estimates of E^-2/3 this close to hard or soft, and this many on either side, place the border."""


@dataclass(frozen=True)
class Answers:
    """A model's answers for n strokes, as the probe gives them.

    value, low, high : (n, outputs), in the units of the wire; y, half : (n, outputs), link scale;
    lump, in_domain : (n), bool; hardness : (n), "hard", "soft" or "unsure".
    """

    value: Floats
    low: Floats
    high: Floats
    y: Floats
    half: Floats
    lump: NDArray[np.bool_]
    in_domain: NDArray[np.bool_]
    hardness: NDArray[np.str_]


@dataclass(frozen=True)
class FieldModel:
    """A fitted field model; `border` is the estimate of E^-2/3 below which a lump counts as hard,
    `fat_kPa` what it was told of the tissue."""

    recipe: Recipe
    polynomial: Polynomial
    widths: Widths
    domain: DomainCheck
    least_amp_share: float
    border: float = HARD_BELOW
    checks: FirstStage | None = None
    fat_kPa: float = 10.0

    def answer(self, observed: ObservedStrokes) -> Answers:
        """Estimates of every stroke, those without a lump too (their numbers mean nothing)."""
        X = observed.columns(self.inputs)
        y = self.polynomial.predict(X[:, : len(self.recipe.features)])
        return self.answer_from(X, y, self.lump(observed))

    def answer_from(self, X: Floats, y: Floats, lump: NDArray[np.bool_]) -> Answers:
        """The same from X (n, inputs), or without the press's, predictions y (n, outputs; link scale) and
        lump (n)."""
        own = X[:, : len(self.recipe.features)]
        z = self.polynomial.standard(own)
        half = self.widths.half(z, y, y[:, E_INV23] < self.border)
        lo, hi = self.polynomial.lo, self.polynomial.hi
        low, high = (from_link(np.clip(y + s * half, lo, hi)) for s in (-1, 1))
        sure_hard, sure_soft = high[:, E_INV23] < self.border, low[:, E_INV23] >= self.border
        hardness = np.where(sure_hard, "hard", np.where(sure_soft, "soft", "unsure"))
        inside = self.domain.inside(own, z, y, half) & ~self.unlike(X)
        return Answers(from_link(y), low, high, y, half, lump, inside, hardness)

    @property
    def inputs(self) -> tuple[str, ...]:
        """The recipe's features, and behind them those of the press that only the checks take."""
        return with_checks(self.recipe.features, self.checks)

    def unlike(self, X: Floats) -> NDArray[np.bool_]:
        """Whether a check is above 0 for X (n, inputs), or without the press's, (n)."""
        if self.checks is None:
            return np.zeros(len(X), bool)
        return above_zero(self.checks, self.inputs[: X.shape[1]], X)

    def lump(self, observed: ObservedStrokes) -> NDArray[np.bool_]:
        """The lump rule."""
        return observed.whole & shows_lump(observed.X, NAMES, self.least_amp_share)

    def spec(self, training: dict[str, Any], force_map: dict[str, Any] | None, **notes: Any) -> ModelSpec:
        """The document that `palpate export` compiles."""
        F = RANGE_LO[0], RANGE_HI[0]
        spec = spec_of(
            "field",
            self.polynomial,
            self.widths,
            self.domain,
            F,
            training,
            force_map,
            notes,
            self.least_amp_share,
            self.border,
            self.fat_kPa,
        )
        version = max(spec.features_version, features_version(self.inputs))
        return replace(spec, checks=self.checks, features_version=version).validate()


def learn_force_map(lumps: Sequence[LumpStrokes], displacement: bool = True) -> force_maps.ForceMap:
    """The map that moves a frame to another force, from the outer strokes of training lumps.

    Images are those of rows, or of whole faces, whose columns' mean then counts.
    """
    low = [lump.low.full() for lump in lumps]
    high = [lump.high.full() for lump in lumps]
    return force_maps.fit(
        np.concatenate([_rows(s) for s in low]),
        np.concatenate([s.displacement_mm for s in low]),
        np.concatenate([_rows(s) for s in high]),
        np.concatenate([s.displacement_mm for s in high]),
        displacement=displacement,
    )


def _rows(stroke: Stroke) -> Floats:
    """What its rows feel (n, 16)."""
    return stroke.images_kPa if stroke.images_kPa.ndim == 2 else stroke.images_kPa.mean(2)


def fit_field_model(
    recipe: Recipe,
    train: ObservedStrokes,
    calibration: ObservedStrokes,
    rim: ObservedStrokes | None = None,
    least_amp_share: float = LEAST_AMP_SHARE,
    step: Callable[[str], None] | None = None,
    checks: FitChecks | None = None,
) -> FieldModel:
    """Fit one recipe.

    Parameters
    ----------
    recipe : Recipe
    train, calibration : ObservedStrokes
        Strokes over lumps, no lump in both; those that show no lump are left out.
    rim : ObservedStrokes, optional
        Strokes over lumps just outside the ranges: the polynomial is fitted to them too, so that it does
        not extrapolate at the ranges' corners; intervals and domain are not.
    least_amp_share : float
        Amp over Base from which a bump counts as a lump.
    step : callable, optional
        Called with what has just been done.
    checks : callable, optional
        Fits the model's checks to its own strokes over lumps (`strange.StrangeStrokes.checks`); without, it
        has none.
    """
    step = step or (lambda what: None)
    rule = (least_amp_share,)
    train = train.take(train.whole & shows_lump(train.X, NAMES, *rule))
    calibration = calibration.take(calibration.whole & shows_lump(calibration.X, NAMES, *rule))
    within = len(train)
    if rim is not None and len(rim):
        rim = rim.take(rim.whole & shows_lump(rim.X, NAMES, *rule))
        train = join([train, replace(rim, group=-1 - rim.group)])
    X, Y = train.columns(recipe.features), to_link(train.Y)
    own = join([train.take(np.arange(within)), calibration])
    fitted = checks(own) if checks else None
    terms = recipe.terms(standardised(X), Y, train.group)
    step("terms chosen")

    def fit(x: Floats, y: Floats, groups: NDArray[np.int64]) -> Polynomial:
        return fit_polynomial(recipe.features, x, y, groups, terms, *_links(LOWEST, HIGHEST))

    model = fit(X, Y, train.group)
    guess = out_of_fold(X, Y, train.group, lambda x, y, g: fit(x, y, g).predict)[:within]
    X, Y = X[:within], Y[:within]
    sigma_terms, sigma = fit_sigma(model.standard(X), guess, Y - guess, train.group[:within])
    # From here on, both kinds of out-of-sample strokes.
    x = calibration.columns(recipe.features)
    guesses, truth = np.concatenate([guess, model.predict(x)]), np.concatenate([Y, to_link(calibration.Y)])
    both = np.concatenate([X, x])
    border = even_odds(guesses[:, E_INV23], truth[:, E_INV23] <= HARD_BELOW)
    z, hard = model.standard(both), guesses[:, E_INV23] < border
    widths = calibrate(sigma_terms, sigma, z, guesses, truth, hard, groups=quarters(from_link(truth)))
    domain = fit_domain(both, z, share_out=UNFAMILIAR_INSIDE)
    half = widths.half(z, guesses, hard)
    groups = np.concatenate([train.group[:within], calibration.group])
    familiar = familiar_unseen(model, both, groups)
    share_out = FLAGGED_INSIDE
    if fitted is not None:
        familiar &= ~above_zero(fitted, NAMES, own.X)
        share_out = WITH_CHECKS
    domain = with_ranges(domain, *_links(RANGE_LO, RANGE_HI), familiar, guesses, half, share_out)
    step("models fitted")
    return FieldModel(recipe, model, widths, domain, least_amp_share, border, fitted)


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


def _links(lo: Sequence[float], hi: Sequence[float]) -> tuple[Floats, Floats]:
    with np.errstate(divide="ignore"):
        return to_link(np.array([lo]))[0], to_link(np.array([hi]))[0]


def quarters(Y: Floats) -> list[NDArray[np.bool_]]:
    """Each quarter of d, h, E^-2/3 and F, as masks of the rows of Y (n, outputs)."""
    out = []
    for column in (2, 3, E_INV23, 0):
        which = np.searchsorted(np.quantile(Y[:, column], [0.25, 0.5, 0.75]), Y[:, column], side="right")
        out += [which == k for k in range(4)]
    return out


def hash_of(*parts: ObservedStrokes) -> str:
    """SHA-256 of all numbers that a model was fitted to."""
    return training_hash(*(array for part in parts for array in (part.X, part.Y)))
