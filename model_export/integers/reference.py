"""The model in float64, as schema.py writes it down: the yardstick of the integer evaluator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from firmware_py import feature_names, outputs
from palpate.model_export.schema import FirstStage, ModelSpec, Term
from palpate.model_export.vocabulary import ABSENT, OF_THE_PRESS


def monomials(z: np.ndarray, terms: Sequence[Term]) -> np.ndarray:
    """Products of columns of z (n x features) for each term: n x terms."""
    out = np.empty((len(z), len(terms)))
    made: dict[Term, int] = {}
    for k, term in enumerate(terms):
        if not term:
            out[:, k] = 1.0
        elif term[:-1] in made:
            np.multiply(out[:, made[term[:-1]]], z[:, term[-1]], out=out[:, k])
        else:
            out[:, k] = z[:, list(term)].prod(axis=1)
        made[term] = k
    return out


def standardised(of: ModelSpec | FirstStage, features: np.ndarray) -> np.ndarray:
    """Features (n x len(of.features), or more) as the polynomials take them: clipped, centred, scaled."""
    own = features[:, : len(of.features)]
    return (np.clip(own, of.clip_lo, of.clip_hi) - np.array(of.centre)) / np.array(of.scale)


def estimates(first: FirstStage, features: np.ndarray) -> np.ndarray:
    """The first stage's values (n x estimates) for features (n x len(first.features)), in its order."""
    z = standardised(first, features)
    y = monomials(z, first.terms) @ np.array([e.coefficients for e in first.estimates]).T
    return np.clip(y, [e.lo for e in first.estimates], [e.hi for e in first.estimates])


def of_press(stage: FirstStage) -> list[bool]:
    """Whether each estimate has a feature of the press: without a press such a check says nothing."""
    pressed = [any(stage.features[i] in OF_THE_PRESS for i in term) for term in stage.terms]
    return [any(of and c != 0 for of, c in zip(pressed, e.coefficients)) for e in stage.estimates]


def checks_of(spec: ModelSpec, features: np.ndarray) -> np.ndarray:
    """The model's checks, n x as many as it has, of what `inputs` gives, or of its own features alone."""
    if spec.checks is None:
        return np.zeros((len(features), 0))
    return checks_among(spec.checks, input_names(spec)[: features.shape[1]], features)


def checks_among(checks: FirstStage, names: Sequence[str], X: np.ndarray) -> np.ndarray:
    """The checks of features X, n x len(names): n x checks, 0 where one says nothing for want of a press.

    Features of the press that are not among these are absent.
    """
    absent = np.full(len(X), ABSENT)
    own = np.column_stack([X[:, names.index(name)] if name in names else absent for name in checks.features])
    pressed = [k for k, name in enumerate(checks.features) if name in OF_THE_PRESS]
    silent = (own[:, pressed] == ABSENT).any(axis=1)[:, None] & np.array(of_press(checks))
    return np.where(silent, 0.0, estimates(checks, own))


def input_names(spec: ModelSpec) -> tuple[str, ...]:
    """The model's features, and behind them those of the press that only its checks take."""
    return with_checks(spec.features, spec.checks)


def with_checks(features: tuple[str, ...], checks: FirstStage | None) -> tuple[str, ...]:
    """These features, and behind them those of the press that only the checks take."""
    more = () if checks is None else checks.features
    return (*features, *(name for name in more if name not in features))


def inputs(spec: ModelSpec, X: np.ndarray) -> np.ndarray:
    """What `evaluate` takes, by `input_names`, from the firmware's features X, n x features.COUNT."""
    names = list(feature_names.NAMES)
    if spec.first is not None:
        own = X[:, [names.index(name) for name in spec.first.features]]
        X = np.column_stack([X, estimates(spec.first, own)])
        names += [e.name for e in spec.first.estimates]
    return X[:, [names.index(name) for name in input_names(spec)]]


def link_ends(spec: ModelSpec) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest prediction of each output, link scale."""
    lo, hi = (np.array([getattr(o, word) for o in spec.outputs]) for word in ("lo", "hi"))
    is_ln = _logarithmic(spec)
    lo[is_ln], hi[is_ln] = np.log(lo[is_ln]), np.log(hi[is_ln])
    return lo, hi


def sigma_of(spec: ModelSpec, z: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Expected size of the residuals round predictions y (n x 5, link scale) at standardised features z."""
    inputs = np.hstack([monomials(z, spec.interval.terms), y])
    return np.exp(inputs @ np.array(spec.interval.coefficients).T)


def half_widths(spec: ModelSpec, y: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Half the intervals' widths, n x 5, link scale: the quantile of a soft or a hard lump times sigma."""
    hard = (y[:, outputs.E_INV23] < spec.hard_below).astype(int)
    return np.array(spec.interval.quantiles).T[hard] * sigma


def _logarithmic(spec: ModelSpec) -> np.ndarray:
    return np.array([o.link == "ln" for o in spec.outputs])


def evaluate(spec: ModelSpec, features: np.ndarray) -> dict[str, Any]:
    """Everything the probe answers for n strokes, in float64.

    Parameters
    ----------
    spec : ModelSpec
    features : array, n x len(spec.features) or as `inputs` gives them
        In feature units and the spec's order.

    Returns
    -------
    dict
        value, low, high (n x 5, units of `schema.OUTPUTS`), y (n x 5, link scale, clipped), sigma (n x 5),
        boxed (n x features: a feature is within its ends), distance (n, squared, 1 at the threshold),
        beyond (n x 5: an estimate is out of its range and margin), unlike (n x checks: a check is above 0),
        in_domain (n), hardness (n strings), force_out (n).
        The lump rule is not applied: it may need features that the model does not use.
    """
    raw = np.atleast_2d(np.asarray(features, float))
    z = standardised(spec, raw)
    is_ln, (lo, hi) = _logarithmic(spec), link_ends(spec)
    y = np.clip(monomials(z, spec.terms) @ np.array([o.coefficients for o in spec.outputs]).T, lo, hi)
    sigma = sigma_of(spec, z, y)
    value = np.where(is_ln, np.exp(y), y)
    width = half_widths(spec, y, sigma)
    ends = [np.clip(y + s * width, lo, hi) for s in (-1, 1)]
    low, high = (np.where(is_ln, np.exp(e), e) for e in ends)
    away = z - np.array(spec.domain.centre)
    distance = np.einsum("ni,ij,nj->n", away, np.array(spec.domain.precision), away) / spec.domain.threshold
    own = raw[:, : len(spec.features)]
    boxed = (own >= spec.domain.lo) & (own <= spec.domain.hi)
    sure_hard, sure_soft = high[:, 4] < spec.hard_below, low[:, 4] >= spec.hard_below
    beyond = _beyond(spec, y, width, is_ln)
    unlike = checks_of(spec, raw) > 0
    force = value[:, 0]
    return {
        "value": value,
        "low": low,
        "high": high,
        "y": y,
        "sigma": sigma,
        "boxed": boxed,
        "distance": distance,
        "in_domain": boxed.all(axis=1) & (distance <= 1) & ~(beyond.any(axis=1) | unlike.any(axis=1)),
        "beyond": beyond,
        "unlike": unlike,
        "hardness": np.where(sure_hard, "hard", np.where(sure_soft, "soft", "unsure")),
        "force_out": (force < spec.force_range[0]) | (force > spec.force_range[1]),
    }


def _beyond(spec: ModelSpec, y: np.ndarray, width: np.ndarray, is_ln: np.ndarray) -> np.ndarray:
    """Whether each estimate lies beyond its declared range by more than the margin, n x 5."""
    ends = np.array(
        [[-np.inf if lo is None else lo, np.inf if hi is None else hi] for lo, hi in spec.domain.ranges]
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        ends[is_ln] = np.log(np.maximum(ends[is_ln], 0))
    excess = np.maximum(ends[:, 0] - y, y - ends[:, 1])
    return np.asarray(excess > spec.domain.margin * width)
