"""`compile`: polynomials given by their terms and coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.fixedpoint import data
from palpate.fixedpoint.assembly import Model
from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.options import Options
from palpate.fixedpoint.polynomials import not_too_many
from palpate.fixedpoint.program import Program
from palpate.fixedpoint.space import Array, Feature, Poly, Space, plus, times

LINKS = ("identity", "exp")
APART = 1e18
"""Between the largest coefficient and the smallest: float64 itself loses the smaller."""


def compile(
    terms: Sequence[Sequence[int]],
    coefficients: Any,
    box: Sequence[tuple[float, float]],
    outputs: int = 1,
    *,
    links: Sequence[str] | None = None,
    centre: Sequence[float] | None = None,
    scale: Sequence[float] | None = None,
    X: Any = None,
    **options: Any,
) -> Program:
    """Polynomials as integers.

    Parameters
    ----------
    terms : list of tuple of int
        Monomials as tuples of indices of features, `()` for the constant, of any degree.
    coefficients : array (outputs, terms), or (terms,) of one output
    box : list of (float, float)
        Ends of each feature, in its unit.
    links : list of str, optional
        "identity", or "exp" where the polynomial is an output's natural logarithm.
    centre, scale : list of float, optional
        The polynomials are of (x - centre) / scale.
    X : array (n, features), optional
        Data over which errors are told, and precision is chosen, beside the box.
    options
        Of `Options`.

    Raises
    ------
    CompileError, ProofError
        In one sentence.
    """
    wanted = Options(**options)
    n = len(box)
    if not n or not len(terms):
        raise CompileError("a polynomial needs a term and a feature at least")
    not_too_many(len(terms))
    words = wanted.features(n)
    rows = np.atleast_2d(data.numbers(coefficients, "coefficients"))
    if rows.shape != (outputs, len(terms)):
        raise CompileError(
            f"coefficients of {outputs} outputs and {len(terms)} terms do not have the shape {rows.shape}"
        )
    if not np.isfinite(rows).all():
        j, k = np.argwhere(~np.isfinite(rows))[0]
        raise CompileError(
            f"the coefficient of term {tuple(terms[k])} of output {j} is {rows[j, k]}, not finite"
        )
    for term in terms:
        if not isinstance(term, tuple | list) or any(
            not isinstance(i, int | np.integer) or not 0 <= i < n for i in term
        ):
            raise CompileError(f"the term {term} is no tuple of indices of the {n} features")
    for row in np.abs(rows):
        if row.any() and row.max() / row[row > 0].min() > APART:
            large, small = (terms[int(k)] for k in (row.argmax(), np.where(row > 0, row, np.inf).argmin()))
            raise CompileError(
                f"the coefficient of {_said(large, words)} is {row.max() / row[row > 0].min():.0e} times "
                f"that of {_said(small, words)}, more than float64 itself can add; leave that out, or scale"
            )
    linked = list(links or ["identity"] * outputs)
    if len(linked) != outputs or any(link not in LINKS for link in linked):
        raise CompileError(f"links must be {outputs} of {', '.join(LINKS)}, not {linked}")
    middle = np.zeros(n) if centre is None else data.numbers(centre, "centre")
    unit = np.ones(n) if scale is None else data.numbers(scale, "scale")
    fits = middle.shape == unit.shape == (n,)
    if not fits or not (np.isfinite(middle) & np.isfinite(unit) & (unit != 0)).all():
        raise CompileError(f"centre and scale must be {n} finite numbers, no scale of them 0")
    own_data = None if X is None else data.table(X)[0]
    step_of = [data.given(wanted.steps, i, name) for i, name in enumerate(words)]
    features = [Feature.over(w, *data.ends(own, w), False, s) for w, own, s in zip(words, box, step_of)]
    space = Space(features)
    z = [
        plus((1 / unit[i], space.linear(i, float(middle[i]))), (-middle[i] / unit[i], {(): 1.0}))
        for i in range(n)
    ]
    polys = [plus(*((c, _product(z, t)) for c, t in zip(row, terms) if c)) for row in rows]

    def reference(values: Array) -> Array:
        values = np.clip(values, [f.lo * f.step for f in features], [f.hi * f.step for f in features])
        own = (values - middle) / unit
        monomials = np.stack([np.prod(own[:, list(t)], axis=1) for t in terms], axis=1)
        y = monomials @ rows.T
        return np.where([link == "exp" for link in linked], np.exp(np.minimum(y, 700)), y)

    model = Model(space, polys, [], [], linked, reference)
    return wanted.program(model, own_data, None)


def _said(term: Sequence[int], names: Sequence[str]) -> str:
    return " * ".join(names[i] for i in term) or "1"


def _product(z: list[Poly], term: Sequence[int]) -> Poly:
    out: Poly = {(): 1.0}
    for i in term:
        out = times(out, z[i])
    return out
