"""The field model: fitted to strokes as the probe sees them, with intervals, domain and lump rule.

Order of work: the force map and the polynomial on training lumps, the size of residuals on out-of-fold
predictions of these, quantiles on both these and calibration lumps, the domain on all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from host.features import Floats
from host.regression.conformal import Widths, calibrate, fit_sigma, out_of_fold
from host.regression.domain import DomainCheck, fit_domain
from host.regression.field.design import LumpPair
from host.regression.probe_model import (
    E_INV23,
    HARD_BELOW,
    LEAST_AMP_SHARE,
    Polynomial,
    fit_polynomial,
    from_link,
    shows_lump,
    spec_of,
    to_link,
    training_hash,
)
from host.regression.ridge import Term, all_terms
from host.regression.seen import NAMES, Seen, join
from model_export import force_map as force_maps
from model_export.schema import ModelSpec

R11 = (
    "ln_force",
    "asinh_amp",
    "ln_stdev",
    "ln_base",
    "ln_d_far",
    "dip_6_10",
    "ln_centre_share",
    "ln_misfit",
    "asinh_rise",
    "trace_7_9",
    "trace_12_16",
)
THESIS_SIX = ("ln_base", "asinh_amp", "ln_stdev", "inv_curvature", "ln_d28", "dip_0_2")
_DISPLACEMENT = ("ln_d28", "ln_d0", "ln_d_far", "dip_0_2", "dip_3_5", "dip_6_10", "dip_12_16", "dip_17_22")

LOWEST = (29.0, 4.0, 5.0, 0.3, 1000.0 ** (-2 / 3))
HIGHEST = (104.0, 40.0, 20.0, 1.5, 2.0 ** (-2 / 3))
"""Ranges of the estimates F (N/m), t, d (mm), h, E^-2/3. One that would lie beyond is held at the end."""


@dataclass(frozen=True)
class Recipe:
    """Which features in which terms, and whether frames are moved to the mean force first."""

    name: str
    features: tuple[str, ...]
    degree: int
    force_map: bool = True
    cubic: tuple[str, ...] = field(default=())

    def terms(self) -> tuple[Term, ...]:
        """All monomials up to `degree`, and of the features in `cubic` those of degree three."""
        terms = all_terms(len(self.features), self.degree)
        among = {self.features.index(name) for name in self.cubic}
        more = [t for t in all_terms(len(self.features), 3) if len(t) == 3 and set(t) <= among]
        return terms + tuple(t for t in more if t not in terms)

    def pressure_only(self) -> Recipe:
        """The same without displacement."""

        def keep(names: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(n for n in names if n not in _DISPLACEMENT)

        return Recipe(
            f"{self.name}, pressure only", keep(self.features), self.degree, self.force_map, keep(self.cubic)
        )


@dataclass(frozen=True)
class Answers:
    """What a model says about n strokes: outputs as the probe gives them.

    value, low, high : (n, 5), in the units of the wire; y, half : (n, 5), link scale;
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
    """A fitted field model."""

    recipe: Recipe
    polynomial: Polynomial
    widths: Widths
    domain: DomainCheck
    least_amp_share: float

    def answer(self, seen: Seen) -> Answers:
        """Estimates of every stroke, those without a lump too (their numbers mean nothing)."""
        X = seen.columns(self.recipe.features)
        y = self.polynomial.predict(X)
        return self.answer_from(X, y, self.lump(seen))

    def answer_from(self, X: Floats, y: Floats, lump: NDArray[np.bool_]) -> Answers:
        """The same from features and predictions on the link scale."""
        z = self.polynomial.standard(X)
        half = self.widths.half(z, y, y[:, E_INV23] < HARD_BELOW)
        lo, hi = self.polynomial.lo, self.polynomial.hi
        low, high = (from_link(np.clip(y + s * half, lo, hi)) for s in (-1, 1))
        sure_hard, sure_soft = high[:, E_INV23] < HARD_BELOW, low[:, E_INV23] >= HARD_BELOW
        hardness = np.where(sure_hard, "hard", np.where(sure_soft, "soft", "unsure"))
        return Answers(from_link(y), low, high, y, half, lump, self.domain.inside(X, z), hardness)

    def at_an_end(self, answers: Answers) -> NDArray[np.bool_]:
        """Whether F, t, d or h stands at an end of its range, or E at the soft one: the lump lies beyond.

        E at its hard end is no such sign, since every stiff lump looks alike.
        """
        y, lo, hi = answers.y, self.polynomial.lo, self.polynomial.hi
        held = (y <= lo + 1e-9) | (y >= hi - 1e-9)
        return held[:, :E_INV23].any(axis=1) | (y[:, E_INV23] >= hi[E_INV23] - 1e-9)

    def lump(self, seen: Seen) -> NDArray[np.bool_]:
        """The lump rule."""
        return seen.whole & shows_lump(seen.X, NAMES, self.least_amp_share)

    def spec(self, training: dict[str, Any], force_map: dict[str, Any] | None, **notes: Any) -> ModelSpec:
        """The document that `palpate export` compiles."""
        F = float(np.exp(self.polynomial.lo[0])), float(np.exp(self.polynomial.hi[0]))
        return spec_of(
            "field",
            self.polynomial,
            self.widths,
            self.domain,
            F,
            training,
            force_map,
            notes,
            self.least_amp_share,
        )


def learn_force_map(pairs: Sequence[LumpPair]) -> force_maps.ForceMap:
    """The map that moves a frame to another force, from both strokes of training lumps."""
    low = [pair.low.full() for pair in pairs]
    high = [pair.high.full() for pair in pairs]
    return force_maps.fit(
        np.concatenate([s.images_kPa for s in low]),
        np.concatenate([s.displacement_mm for s in low]),
        np.concatenate([s.images_kPa for s in high]),
        np.concatenate([s.displacement_mm for s in high]),
    )


def fit_field_model(
    recipe: Recipe,
    train: Seen,
    calibration: Seen,
    rim: Seen | None = None,
    least_amp_share: float = LEAST_AMP_SHARE,
) -> FieldModel:
    """Fit one recipe.

    Parameters
    ----------
    recipe : Recipe
    train, calibration : Seen
        Strokes over lumps, no lump in both; those that show no lump are left out.
    rim : Seen, optional
        Strokes over lumps just outside the ranges: the polynomial is fitted to them too, so that it does
        not hang free at the ranges' corners; intervals and domain are not.
    least_amp_share : float
        Amp over Base from which a bump counts as a lump.
    """
    rule = (least_amp_share,)
    train = train.take(train.whole & shows_lump(train.X, NAMES, *rule))
    calibration = calibration.take(calibration.whole & shows_lump(calibration.X, NAMES, *rule))
    within = len(train)
    if rim is not None and len(rim):
        rim = rim.take(rim.whole & shows_lump(rim.X, NAMES, *rule))
        train = join([train, replace(rim, group=-1 - rim.group)])
    X, Y = train.columns(recipe.features), to_link(train.Y)
    lo, hi = to_link(np.array([LOWEST]))[0], to_link(np.array([HIGHEST]))[0]
    terms = recipe.terms()

    def fit(x: Floats, y: Floats, groups: NDArray[np.int64]) -> Polynomial:
        return fit_polynomial(recipe.features, x, y, groups, terms, lo, hi)

    model = fit(X, Y, train.group)
    guess = out_of_fold(X, Y, train.group, lambda x, y, g: fit(x, y, g).predict)[:within]
    X, Y = X[:within], Y[:within]
    sigma_terms, sigma = fit_sigma(model.standard(X), guess, Y - guess, train.group[:within])
    x = calibration.columns(recipe.features)
    z, y = model.standard(x), model.predict(x)
    guesses, truth = np.concatenate([guess, y]), np.concatenate([Y, to_link(calibration.Y)])
    all_z = np.concatenate([model.standard(X), z])
    widths = calibrate(sigma_terms, sigma, all_z, guesses, truth, guesses[:, E_INV23] < HARD_BELOW)
    both = np.concatenate([X, x])
    return FieldModel(recipe, model, widths, fit_domain(both, model.standard(both)), least_amp_share)


def hash_of(train: Seen, calibration: Seen) -> str:
    """SHA-256 of all numbers that a model was fitted to."""
    return training_hash(train.X, train.Y, calibration.X, calibration.Y)
