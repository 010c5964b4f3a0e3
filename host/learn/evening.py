"""Expected sizes of residuals, bent until intervals hold in every part of the lumps alike.

Intervals that hold nine in ten of all lumps hold fewer of some: of the hardest, whose stiffness is taken for
less than it is. Which lumps these are nobody knows when an estimate is made, but features and estimates
know something of it, and the size of the residual is log-linear in both. So its coefficients are changed
until every part holds nearly as often as all, as far as `PRICE` and `NARROWING` allow: intervals may grow,
but hardly shrink, for else those that say most would hold least (narrowed freely, the narrowest tenth held
65 %). Gibbs, Cherian and Candes (2023) ask for the same of classes of functions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from palpate.features.map_features import Floats
from palpate.model_export.integers.reference import monomials

BELOW = 0.005
"""Parts are asked to hold this much less than all."""

PRICE = 0.001
"""Of intervals twice as wide as they were, beside the square of what a part lacks."""

NARROWING = 0.02
"""Of the square of a narrower interval's logarithm, beside the same."""

_OF_ALL = 4.0
"""Weight of the square of what all lack."""
_SOFTNESS = 0.15
"""Of the edge of an interval, on the logarithm of a residual over its expected size."""
_WIDEST = 8.0


def evened(
    terms: Sequence[tuple[int, ...]],
    coefficients: Floats,
    z: Floats,
    predicted: Floats,
    truth: Floats,
    groups: Sequence[NDArray[np.bool_]],
    level: float,
    together: Sequence[Sequence[int]] = (),
) -> Floats:
    """The coefficients (terms + outputs, outputs) of `conformal.Widths`, changed for the sake of `groups`.

    Parameters
    ----------
    terms, coefficients, z, predicted, truth, level
        As in `conformal.calibrate`: out-of-fold predictions (n, outputs), standardised features.
    groups : sequence of (n,), bool
        Parts of these strokes; where all of them hold, next to nothing changes.
    together : sequence of outputs
        Those whose widths change by one factor.
    """
    shares = np.array([group / group.sum() for group in groups if group.any()])
    if not len(shares):
        return coefficients
    A = np.hstack([monomials(z, terms), predicted])
    centre, scale = A.mean(0), A.std(0)
    known = scale > 0
    E = np.column_stack([np.ones(len(A)), (A[:, known] - centre[known]) / scale[known]])
    size = np.log(np.maximum(np.abs(truth - predicted), np.finfo(float).tiny)) - A @ coefficients
    size -= np.quantile(size, level, axis=0)
    constant = list(terms).index(())
    out = coefficients.copy()
    alone = [(j,) for j in range(size.shape[1]) if not any(j in some for some in together)]
    for outputs in [*alone, *map(tuple, together)]:
        change = np.zeros(len(centre))
        change[known] = _bent(E, size[:, outputs], shares, level)[1:] / scale[known]
        change[constant] -= centre @ change
        out[:, outputs] += change[:, None]
    return out


def _bent(E: Floats, size: Floats, shares: Floats, level: float) -> Floats:
    """Coefficients (k) of the columns of E (n, k), the first of which is 1, that even out who is covered.

    size : (n, outputs), logarithm of the residuals over half of their intervals; shares : (groups, n), each
    with a sum of 1.
    """
    n, outputs = size.shape

    def lack(a: Floats) -> tuple[float, Floats]:
        wider = E @ a
        inside = 0.5 * (1 + np.tanh((wider[:, None] - size) / (2 * _SOFTNESS)))
        short = np.maximum(level - BELOW - shares @ inside, 0.0)
        off = np.minimum(inside.mean(0) - level, 0.0)
        more, less = np.expm1(np.minimum(wider, _WIDEST)), np.minimum(wider, 0.0)
        price = PRICE * (more - wider).mean() + NARROWING * (less**2).mean()
        cost = (short**2).sum() + _OF_ALL * (off**2).sum() + outputs * price
        slope = (_OF_ALL * off / n - shares.T @ short) * inside * (1 - inside) * 2 / _SOFTNESS
        dearer = outputs * (PRICE * more + 2 * NARROWING * less) / n
        return float(cost), E.T @ (slope.sum(1) + dearer)

    return np.asarray(minimize(lack, np.zeros(E.shape[1]), jac=True, method="L-BFGS-B").x)
