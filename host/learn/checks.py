"""What a stroke is unlike: polynomials of a model's features that tell strange strokes from its own.

The box, the distance and the ranges (`domain`) ask whether features are like those of training, one by one
and all together; they do not know which combinations lead astray. Two lumps side by side look like one that
is wider and softer, and pass. A check is fitted to such strokes as well: least squares of 1 against 0 over
monomials, its border where a stated share of the model's own strokes is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.features.map_features import Floats
from palpate.learn.conformal import out_of_fold
from palpate.learn.probe_model import Polynomial, fit_polynomial, floats, stage_of, standardised
from palpate.learn.ridge import Term, all_terms, fit_ridge, importance
from palpate.model_export.integers.reference import checks_among, monomials
from palpate.model_export.schema import Estimate, FirstStage

Groups = NDArray[np.int64]
Strange = Mapping[str, tuple[Floats, Groups]]

FALSE_ALARMS = 0.01
"""Share of the model's own strokes, lumps not met, that each check may leave out."""

MOST_FEATURES, DEGREE, FOLDS = 14, 2, 4
STRENGTHS = 10.0 ** np.arange(-7.0, -1.9, 1.0)
_SIZE = 1 / 64
"""Only a check's sign counts: so small, its coefficients take fewer bits."""


def fit_checks(
    names: Sequence[str],
    X: Floats,
    groups: Groups,
    strange: Strange,
    false_alarms: float = FALSE_ALARMS,
    most_features: int = MOST_FEATURES,
    most_terms: int | None = None,
    how_far: Mapping[str, Floats] | None = None,
) -> FirstStage:
    """A check for each kind of strange strokes, all of the same few features.

    Parameters
    ----------
    names : the model's features
    X : (n, features)
        The model's own strokes, as its polynomial takes them.
    groups : (n)
        Which lump.
    strange : kind -> ((m, features), (m)), one to three
        Strokes that are to be told apart, and their lumps by the same numbers.
    false_alarms : float
        Share of strokes like X, over lumps that were not met, where a check may be above 0.
    most_features : int
    most_terms : int, optional
        Only those worth most to the checks together; a small board has no room for all.
    how_far : kind -> (m), optional
        How far each strange stroke is off: what its check is fitted to be there, in place of 1. Where little
        and much are to be told apart by one number, it learns the number. Features then count as far as the
        strange strokes go.
    """
    chosen = _chosen(X, groups, strange, most_features)
    part = tuple(names[i] for i in chosen)
    terms = all_terms(len(chosen), DEGREE)
    if most_terms is not None:
        worth = _worth(X, groups, strange, chosen, terms)
        worth[[len(term) < 2 for term in terms]] = np.inf
        terms = tuple(terms[k] for k in np.sort(np.argsort(-worth, kind="stable")[:most_terms]))
    seen = X if how_far is None else np.concatenate([X, *(other for other, _ in strange.values())])
    known = _fit(part, seen[:, chosen], np.zeros(len(seen)), np.arange(len(seen)), terms)
    estimates = []
    for kind, (other, their_groups) in strange.items():
        A, y, g = _together(X[:, chosen], groups, other[:, chosen], their_groups)
        if how_far is not None:
            y[len(X) :] = how_far[kind]

        def fit(x: Floats, target: Floats, of: Groups) -> Polynomial:
            return _fit(part, x, target[:, 0], of, terms, known)

        unseen = out_of_fold(A, y[:, None], g, lambda x, t, of: fit(x, t, of).predict, FOLDS)
        border = np.quantile(unseen[: len(X), 0], 1 - false_alarms)
        coefficients = fit(A, y[:, None], g).coefficients[:, 0] * _SIZE
        coefficients[terms.index(())] -= border * _SIZE
        estimates.append(Estimate(kind, -1.0, 1.0, floats(coefficients)))
    return stage_of(known, estimates)


def above_zero(checks: FirstStage, names: Sequence[str], X: Floats) -> NDArray[np.bool_]:
    """Whether a check is above 0, (n), of features X (n, names)."""
    return np.asarray((checks_among(checks, names, X) > 0).any(axis=1))


def joined(one: FirstStage, other: FirstStage) -> FirstStage:
    """The checks of both, which have no feature in common."""
    past = len(one.features)
    shifted = [tuple(past + i for i in term) for term in other.terms]
    terms = (*one.terms, *(term for term in shifted if term))
    checks = [replace(e, coefficients=_over(terms, one.terms, e.coefficients)) for e in one.estimates]
    checks += [replace(e, coefficients=_over(terms, shifted, e.coefficients)) for e in other.estimates]
    return FirstStage(
        (*one.features, *other.features),
        (*one.centre, *other.centre),
        (*one.scale, *other.scale),
        (*one.clip_lo, *other.clip_lo),
        (*one.clip_hi, *other.clip_hi),
        terms,
        tuple(checks),
    )


def _over(terms: Sequence[Term], own: Sequence[Term], coefficients: Sequence[float]) -> tuple[float, ...]:
    """The same coefficients over other terms, 0 for those that had none."""
    of = dict(zip(own, coefficients))
    return tuple(of.get(term, 0.0) for term in terms)


def _together(X: Floats, groups: Groups, other: Floats, their: Groups) -> tuple[Floats, Floats, Groups]:
    """Both kinds of strokes, 0 for the model's own and 1 for the others, and their lumps."""
    y = np.r_[np.zeros(len(X)), np.ones(len(other))]
    return np.concatenate([X, other]), y, np.concatenate([groups, their])


def _fit(
    names: Sequence[str],
    X: Floats,
    y: Floats,
    groups: Groups,
    terms: Sequence[Term],
    known: Polynomial | None = None,
) -> Polynomial:
    """The polynomial of y (n); features are standardised as in `known`, of the same terms, or by X."""
    if known is None:
        ends = np.array([-8.0]), np.array([8.0])
        return fit_polynomial(names, X, y[:, None], groups, terms, *ends, STRENGTHS)
    A = monomials(known.standard(X), terms)
    B = fit_ridge(A, y[:, None], [len(t) for t in terms], groups, STRENGTHS).coefficients
    return replace(known, coefficients=B)


def _worth(X: Floats, groups: Groups, strange: Strange, features: list[int], terms: Sequence[Term]) -> Floats:
    """What each term of these features is worth to all checks together, (terms)."""
    worth = np.zeros(len(terms))
    degrees = [len(t) for t in terms]
    for other, their in strange.values():
        A, y, g = _together(X[:, features], groups, other[:, features], their)
        A = monomials(standardised(A), terms)
        of_terms = importance(A, degrees, fit_ridge(A, y[:, None], degrees, g, STRENGTHS))
        worth += of_terms / of_terms.sum()
    return worth


def _chosen(X: Floats, groups: Groups, strange: Strange, most: int) -> list[int]:
    """The features worth most to all checks together: half of the others are dropped at a time."""
    left = list(range(X.shape[1]))
    while len(left) > most:
        terms = all_terms(len(left), DEGREE)
        of_terms = _worth(X, groups, strange, left, terms)
        worth = np.array([sum(w for w, t in zip(of_terms, terms) if i in t) for i in range(len(left))])
        keep = len(left) - (len(left) - most + 1) // 2
        left = [left[i] for i in np.sort(np.argsort(-worth, kind="stable")[:keep])]
    return left
