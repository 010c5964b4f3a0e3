"""The thesis' inverse equations: each input as a short polynomial of the features (Appendix C, Table 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import statsmodels.api as sm
from numpy.typing import NDArray
from statsmodels.stats.outliers_influence import OLSInfluence, variance_inflation_factor

from palpate.learn.conformal import LEVEL
from palpate.learn.table import (
    DISPLACEMENT,
    NAMES,
    PRESSURE,
    SHOWN,
    TARGETS,
    coordinates,
    r_squared,
    rmse,
    target_values,
)
from palpate.learn.thesis.subsets import best_r2, best_subset, nested_leave_one_out

MOST_TERMS = 5
LOG_TARGETS = tuple(target for target in TARGETS if target not in ("h", "E_inv23"))
"""h and E^-2/3 regress better untransformed: their spread over the runs is already even."""


@dataclass(frozen=True)
class DirectEquation:
    """One inverse equation with its full statistics.

    Attributes
    ----------
    target : str
        F, t, d, h or E_inv23.
    log : bool
        Whether the equation gives the target's logarithm.
    terms : tuple of str
        Its terms, intercept left out.
    table : DataFrame
        One row a term: coefficient, standard error, t, P, VIF.
    r2, r2_adjusted : float
        In sample, in the equation's own scale.
    r2_in, r2_loo, rmse_in, rmse_loo : float
        In the target's scale (mm for t and d), in sample and nested leave-one-out.
    runs : DataFrame
        One row a run: truth, estimate, low, high (prediction interval), loo, leverage, cook.
    """

    target: str
    log: bool
    terms: tuple[str, ...]
    table: pd.DataFrame
    r2: float
    r2_adjusted: float
    r2_in: float
    r2_loo: float
    rmse_in: float
    rmse_loo: float
    runs: pd.DataFrame

    def text(self) -> str:
        """The equation in readable form."""
        left = f"ln {SHOWN[self.target]}" if self.log else SHOWN[self.target]
        return equation_text(left, self.table["coefficient"])


def equation_text(left: str, coefficients: pd.Series) -> str:
    """`left` = first + second term + ..., the coefficients to four digits."""
    parts = []
    for name, value in coefficients.items():
        body = f"{abs(value):.4g}" if name == "1" else f"{abs(value):.4g} ({name})"
        parts.append(("-" if value < 0 else "+", body))
    first = ("-" if parts[0][0] == "-" else "") + parts[0][1]
    return f"{left} = " + " ".join([first, *(f"{sign} {body}" for sign, body in parts[1:])])


def candidate_terms(outputs: pd.DataFrame, displacement: bool) -> pd.DataFrame:
    """Terms to choose from: feature coordinates and, from fifteen runs on, their squares."""
    features = PRESSURE + (DISPLACEMENT if displacement else ())
    linear = {NAMES[name]: outputs[name] for name in features}
    squares = {f"({NAMES[name]})^2": outputs[name] ** 2 for name in features if len(outputs) >= 15}
    return pd.DataFrame({**linear, **squares})


def most_terms_for(n: int) -> int:
    """Five terms for 29 runs, three for the seven runs with E < 10."""
    return min(MOST_TERMS, (n - 1) // 2)


def fit_direct(
    table: pd.DataFrame, target: str, displacement: bool, rows: NDArray[np.bool_]
) -> DirectEquation:
    """Choose the terms of one inverse equation and fit it.

    Parameters
    ----------
    table : DataFrame
        The runs (see `table.check_table`); features are taken relative to the reference case among them.
    target : str
    displacement : bool
        Whether the displacement features may be used beside those of pressure.
    rows : bool array
        The runs to fit, as E >= 10.
    """
    X = candidate_terms(coordinates(table)[rows], displacement)
    truth = target_values(table)[target][rows].to_numpy()
    log = target in LOG_TARGETS
    y = np.log(truth) if log else truth
    back = np.exp if log else (lambda v: v)
    most = most_terms_for(len(y))

    chosen = best_subset(X.to_numpy(), y, most)
    design = X.iloc[:, list(chosen.columns)]
    design.insert(0, "1", 1.0)
    result = sm.OLS(y, design).fit()
    influence = OLSInfluence(result)
    frame = result.get_prediction(design).summary_frame(alpha=1 - LEVEL)
    loo = back(nested_leave_one_out(X.to_numpy(), y, most)[0])
    estimate = back(result.fittedvalues.to_numpy())
    return DirectEquation(
        target,
        log,
        tuple(design.columns[1:]),
        coefficient_table(result),
        float(result.rsquared),
        float(result.rsquared_adj),
        r_squared(truth, estimate),
        r_squared(truth, loo),
        rmse(truth, estimate),
        rmse(truth, loo),
        pd.DataFrame(
            {
                "code": table["code"][rows].to_numpy(),
                "truth": truth,
                "estimate": estimate,
                "low": back(frame["obs_ci_lower"].to_numpy()),
                "high": back(frame["obs_ci_upper"].to_numpy()),
                "loo": loo,
                "leverage": influence.hat_matrix_diag,
                "cook": influence.cooks_distance[0],
            }
        ),
    )


def coefficient_table(result: sm.regression.linear_model.RegressionResultsWrapper) -> pd.DataFrame:
    """Coefficient, standard error, t, P and VIF of every term; the intercept is first (Appendices B, C)."""
    X = result.model.exog
    terms = range(1, X.shape[1])
    vif = [np.nan, *(variance_inflation_factor(X, k) if len(terms) > 1 else 1.0 for k in terms)]
    return pd.DataFrame(
        {
            "coefficient": result.params,
            "standard_error": result.bse,
            "t": result.tvalues,
            "P": result.pvalues,
            "VIF": vif,
        }
    )


@dataclass(frozen=True)
class PermutationTest:
    """A permutation test, in the equation's own scale.

    Attributes
    ----------
    r2 : float
        In sample, of the runs as they are.
    r2_by_chance : float
        What 95 % of the shuffles stay below.
    P : float
        Share of shuffles (the true order counted among them) that reach `r2`.
    """

    target: str
    displacement: bool
    r2: float
    r2_by_chance: float
    P: float


def permutation_test(table: pd.DataFrame, target: str, displacement: bool, draws: int) -> PermutationTest:
    """Could chance reach this R2? The target is shuffled among the runs and the terms are chosen again."""
    X = candidate_terms(coordinates(table), displacement).to_numpy()
    truth = target_values(table)[target].to_numpy()
    y = np.log(truth) if target in LOG_TARGETS else truth
    rng = np.random.default_rng(1)
    Y = np.column_stack([y, *(rng.permutation(y) for _ in range(draws))])
    actual, *shuffled = best_r2(X, Y, most_terms_for(len(y)))
    return PermutationTest(
        target,
        displacement,
        float(actual),
        float(np.quantile(shuffled, 0.95)),
        float((1 + np.sum(shuffled >= actual)) / (draws + 1)),
    )
