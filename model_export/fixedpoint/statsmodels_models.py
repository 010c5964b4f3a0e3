"""`from_statsmodels`: results of OLS, WLS, GLS, GLM, RLM and quantile regressions."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.fixedpoint import data
from palpate.fixedpoint.assembly import Model
from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.options import Options
from palpate.fixedpoint.program import Program
from palpate.fixedpoint.space import Array, plus
from palpate.fixedpoint.transformers import Columns, Raw

_KNOWN = ("OLS", "WLS", "GLS", "GLSAR", "GLM", "RLM", "QuantReg")
_CONSTANTS = ("const", "Intercept")


def from_statsmodels(results: Any, X: Any, **options: Any) -> Program:
    """Fitted results as integers; X holds the columns of the model but the constant (see `from_sklearn`)."""
    wanted = Options(**options)
    kind = type(getattr(results, "model", results)).__name__
    if not hasattr(results, "params"):
        raise CompileError(f"{kind} was never fitted; give what its fit() returned")
    if kind not in _KNOWN:
        raise CompileError(f"{kind} cannot be compiled; take one of {', '.join(_KNOWN)}")
    link = "identity"
    if kind == "GLM":
        called = type(results.model.family.link).__name__
        if called.lower() not in ("identity", "log"):
            raise CompileError(
                f"a GLM with the link {called} cannot be compiled; take the link Log or Identity"
            )
        link = "exp" if called.lower() == "log" else "identity"
    table, columns = data.table(X)
    params = np.asarray(results.params, float)
    exogenous = list(results.model.exog_names)
    constant = 0.0
    kept = []
    for name, value in zip(exogenous, params):
        if name in _CONSTANTS:
            constant = float(value)
        else:
            kept.append((name, float(value)))
    if columns is not None and set(columns) >= {n for n, _ in kept}:
        places = [columns.index(n) for n, _ in kept]
    elif columns is None and len(kept) == table.shape[1]:
        places = list(range(len(kept)))
    else:
        made = columns is not None and getattr(results.model, "formula", None) is not None
        raise CompileError(
            f"the results are of the columns {', '.join(n for n, _ in kept)}, X has "
            f"{', '.join(columns or [f'{table.shape[1]} without names'])}"
            + (
                "; what a formula makes the device is given: add it to X"
                if made
                else "; leave out the constant"
            )
        )
    if not np.isfinite(params).all():
        raise CompileError(f"{kind} has a coefficient that is not finite; fit it again")
    space = wanted.space(table, columns)
    columns_of = Columns(space)
    parts = [(value, columns_of.poly(Raw(i))) for i, (_, value) in zip(places, kept) if value]
    row = np.zeros(table.shape[1])
    for i, (_, value) in zip(places, kept):
        row[i] += value

    def reference(values: Array) -> Array:
        y = values @ row + constant
        return (np.exp(y) if link == "exp" else y)[:, None]

    model = Model(space, [plus(*parts, (constant, {(): 1.0}))], ["y"], [""], [link], reference)
    return wanted.program(model, table, columns)
