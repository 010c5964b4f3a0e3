"""A log-polynomial model of the probe's integer features, fitted in float64 and written as a ModelSpec.

Both kinds end here: `fit_polynomial` learns the inverse from examples, `spec_of` adds intervals, domain and
rules. Features are standardised; each output's link is the logarithm but for E^-2/3, which is used as it is.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import feature_names, model_image, outputs
from firmware_py import features as firmware_features
from palpate.features.map_features import Floats
from palpate.learn.conformal import Widths
from palpate.learn.domain import DomainCheck
from palpate.learn.ridge import STRENGTHS, Term, fit_ridge
from palpate.model_export.integers.reference import monomials
from palpate.model_export.schema import (
    Domain,
    Estimate,
    FirstStage,
    Interval,
    Joining,
    Limit,
    ModelSpec,
    Output,
)
from palpate.model_export.vocabulary import SYMBOLS
from palpate.spans import BORDER

HARD_BELOW = BORDER ** (-2 / 3)
LUMP = (Limit("asinh_amp", lo=math.asinh(100 * 0.01)), Limit("ln_stdev", hi=math.log(20.0)))
"""The lump rule of every model: Amp over 1 % of Base, Stdev under 20 mm."""
_TAIL, _ROOM = 0.001, 0.1
_LINK_LN = np.array(outputs.LOGARITHMIC)
E_INV23 = outputs.E_INV23
OUTPUTS = tuple(
    f"ln {symbol}" if logarithmic else {"E_inv23": "E^-2/3"}.get(symbol, symbol)
    for symbol, logarithmic in zip(SYMBOLS, outputs.LOGARITHMIC)
)
"""Names of the outputs on the polynomials' scale: ln F, ln t, ln d, ln h, E^-2/3, ln E_fat."""


def to_link(values: Floats) -> Floats:
    """Outputs `values` (n, all or the first) in the units of the wire, on the polynomials' scale."""
    out = np.array(values, float)
    logarithmic = _LINK_LN[: out.shape[1]]
    out[:, logarithmic] = np.log(out[:, logarithmic])
    return out


def from_link(y: Floats) -> Floats:
    """Outputs (n, outputs) in the units of the wire, from y (n, outputs) on the link scale."""
    out = np.array(y, float)
    logarithmic = _LINK_LN[: out.shape[1]]
    out[:, logarithmic] = np.exp(out[:, logarithmic])
    return out


@dataclass(frozen=True)
class Polynomial:
    """The inverse model proper: standardise, clip, multiply out, add up.

    Attributes
    ----------
    names : names of the firmware's features
    centre, scale, clip_lo, clip_hi : (features)
    terms : monomials
    coefficients : (terms, outputs)
    lo, hi : (outputs)
        Range of the predictions on the link scale.
    """

    names: tuple[str, ...]
    centre: Floats
    scale: Floats
    clip_lo: Floats
    clip_hi: Floats
    terms: tuple[Term, ...]
    coefficients: Floats
    lo: Floats
    hi: Floats

    def standard(self, X: Floats) -> Floats:
        """Features X (n, features), standardised."""
        return (np.clip(X, self.clip_lo, self.clip_hi) - self.centre) / self.scale

    def predict(self, X: Floats) -> Floats:
        """Outputs on the link scale, (n, outputs), from features X (n, features)."""
        return np.clip(monomials(self.standard(X), self.terms) @ self.coefficients, self.lo, self.hi)


def features_version(names: Sequence[str]) -> int:
    """The first version of the firmware's features that has all of these: older probes take such a model."""
    newest = max(map(feature_names.NAMES.index, names))
    f = firmware_features
    return 1 + sum(newest >= first for first in (f.PRESS, f.PRESS_OUTER, f.BUMP, f.ACROSS))


def fit_polynomial(
    names: Sequence[str],
    X: Floats,
    Y: Floats,
    groups: NDArray[np.int64],
    terms: Sequence[Term],
    lo: Floats,
    hi: Floats,
    strengths: Floats = STRENGTHS,
) -> Polynomial:
    """Fit the inverse by ridge regression, its strength cross-validated over whole lumps.

    Parameters
    ----------
    names : names of the features in X
    X : (n, features)
    Y : (n, outputs)
        Link scale.
    groups : (n)
        Which lump each row belongs to.
    terms : monomials to use
    lo, hi : (outputs)
        Range of the outputs, link scale.
    strengths : (candidates)
        Of the ridge, to choose from.
    """
    shape = _shape(names, X, terms, lo, hi)
    A = monomials(shape.standard(X), terms)
    B = fit_ridge(A, Y, [len(t) for t in terms], groups, strengths).coefficients
    return replace(shape, coefficients=B)


def _shape(names: Sequence[str], X: Floats, terms: Sequence[Term], lo: Floats, hi: Floats) -> Polynomial:
    centre, scale = np.median(X, axis=0), X.std(axis=0) + 1e-9
    clip_lo, clip_hi = np.quantile(X, [_TAIL, 1 - _TAIL], axis=0)
    room = _ROOM * (clip_hi - clip_lo)
    none = np.empty(0)
    return Polynomial(tuple(names), centre, scale, clip_lo - room, clip_hi + room, tuple(terms), none, lo, hi)


def standardised(X: Floats) -> Floats:
    """Features X (n, features) as `fit_polynomial` would standardise them."""
    return _shape((), X, (), np.empty(0), np.empty(0)).standard(X)


def stage_of(model: Polynomial, estimates: Sequence[Estimate], joining: Joining | None = None) -> FirstStage:
    """These estimates of the model's features as the part of a document that compiles to a stage."""
    return FirstStage(
        features=model.names,
        centre=floats(model.centre),
        scale=floats(model.scale),
        clip_lo=floats(model.clip_lo),
        clip_hi=floats(model.clip_hi),
        terms=model.terms,
        estimates=tuple(estimates),
        joining=joining,
    )


def estimates_of(model: Polynomial, names: Sequence[str]) -> tuple[Estimate, ...]:
    """The model's outputs under these names."""
    return tuple(
        Estimate(name, float(low), float(high), floats(coefficients))
        for name, low, high, coefficients in zip(names, model.lo, model.hi, model.coefficients.T)
    )


def spec_of(
    kind: str,
    model: Polynomial,
    widths: Widths,
    domain: DomainCheck,
    force_range_N_per_m: tuple[float, float],
    training: dict[str, Any],
    force_map: dict[str, Any] | None = None,
    notes: dict[str, Any] | None = None,
    hard_below: float = HARD_BELOW,
    fat_kPa: float | None = None,
    first: FirstStage | None = None,
) -> ModelSpec:
    """A fitted model as the document that `palpate export` compiles.

    A model that does not estimate E_fat was told `fat_kPa`, and repeats it. `first` is the stage whose
    estimates are among the model's features.
    """
    if fat_kPa is not None and len(model.lo) < len(_LINK_LN):
        model, widths, domain = _told(fat_kPa, model, widths, domain)
    lo, hi = from_link(model.lo[None])[0], from_link(model.hi[None])[0]
    estimated = tuple(
        Output(
            name,
            "ln" if _LINK_LN[j] else "identity",
            float(lo[j]),
            float(hi[j]),
            tuple(map(float, model.coefficients[:, j])),
        )
        for j, name in enumerate(outputs.NAMES)
    )
    names = [*model.names, *(() if first is None else first.features)]
    return ModelSpec(
        kind=kind,
        probe=model_image.PROBE.decode(),
        features_version=features_version([n for n in names if n in feature_names.NAMES]),
        features=model.names,
        centre=floats(model.centre),
        scale=floats(model.scale),
        clip_lo=floats(model.clip_lo),
        clip_hi=floats(model.clip_hi),
        terms=model.terms,
        outputs=estimated,
        interval=Interval(
            widths.level,
            widths.terms,
            tuple(floats(c) for c in widths.coefficients.T),
            tuple((float(a), float(b)) for a, b in widths.quantiles),
        ),
        domain=Domain(
            floats(np.maximum(domain.lo, model.clip_lo)),
            floats(np.minimum(domain.hi, model.clip_hi)),
            floats(domain.centre),
            tuple(floats(row) for row in domain.precision),
            domain.threshold,
            _ranges(model, domain),
            domain.margin,
        ),
        lump=LUMP,
        hard_below=hard_below,
        force_range=force_range_N_per_m,
        training=training,
        force_map=force_map,
        notes=notes or {},
        first=first,
    ).validate()


def _told(
    fat_kPa: float, model: Polynomial, widths: Widths, domain: DomainCheck
) -> tuple[Polynomial, Widths, DomainCheck]:
    """The same with one more output, ln `fat_kPa` whatever the features are, without an interval."""
    constant = np.array([[math.log(fat_kPa) if not term else 0.0] for term in model.terms])
    room = math.log(2.0)
    of_sigma = np.vstack([widths.coefficients, np.zeros((1, widths.coefficients.shape[1]))])
    return (
        replace(
            model,
            coefficients=np.hstack([model.coefficients, constant]),
            lo=np.append(model.lo, math.log(fat_kPa) - room),
            hi=np.append(model.hi, math.log(fat_kPa) + room),
        ),
        replace(
            widths,
            coefficients=np.hstack([of_sigma, np.zeros((len(of_sigma), 1))]),
            quantiles=np.vstack([widths.quantiles, np.zeros((1, 2))]),
        ),
        replace(
            domain, range_lo=np.append(domain.range_lo, -np.inf), range_hi=np.append(domain.range_hi, np.inf)
        ),
    )


def _ranges(model: Polynomial, domain: DomainCheck) -> tuple[tuple[float | None, float | None], ...]:
    """The domain's ranges in the units of the wire; an end beyond the prediction's own is none."""
    ends = []
    sides = (domain.range_lo, domain.range_hi)
    for side, beyond in zip(sides, (sides[0] <= model.lo, sides[1] >= model.hi)):
        values = from_link(np.where(beyond, 0.0, side)[None])[0]
        ends.append([None if none else float(v) for v, none in zip(values, beyond)])
    return tuple(zip(*ends))


def shows_lump(X: Floats, names: Sequence[str], rule: Sequence[Limit] = LUMP) -> NDArray[np.bool_]:
    """Whether features X (n, features) with these names keep a model's lump rule."""
    shown = np.ones(len(X), bool)
    for limit in rule:
        x = X[:, list(names).index(limit.feature)]
        shown &= x >= (-np.inf if limit.lo is None else limit.lo)
        shown &= x <= (np.inf if limit.hi is None else limit.hi)
    return shown


def training_hash(*arrays: Floats) -> str:
    """SHA-256 of the numbers that a model was fitted to."""
    digest = hashlib.sha256()
    for a in arrays:
        digest.update(np.ascontiguousarray(a, dtype="<f8").tobytes())
    return digest.hexdigest()


def floats(values: Floats) -> tuple[float, ...]:
    """As a document holds them."""
    return tuple(map(float, values))
