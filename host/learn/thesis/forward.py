"""The thesis' forward model: each input alone, and all together (its Figures 13 and 17, Appendix B)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
import statsmodels.api as sm

from palpate.features.map_features import Floats
from palpate.learn.table import FEATURES, REFERENCE_CODE, SYMBOL_OF, r_squared, relative
from palpate.learn.thesis.direct import coefficient_table, equation_text

OUTPUT_NAMES = {
    "base_kPa": "Base",
    "amp_kPa": "Amp",
    "stdev_mm": "Stdev",
    "curvature": "Curvature",
    "D28_mm": "D28",
    "D0_mm": "D0",
}
FAR_OUTPUTS = ("base_kPa", "curvature", "D28_mm")
"""Measured far from the lump: only F and the fat's thickness can matter."""

P_STAY = 0.05
WORTH = 0.001
"""Adjusted R2 that a term must bring."""

CURVATURE_POWERS = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
"""n of the term F^-n that Curvature may take; 0 is ln F."""

KNOWN_DIRECTIONS: dict[str, dict[str, int]] = {
    "base_kPa": {"F": 1},
    "amp_kPa": {"F": 1, "h": -1, "E": 1},
    "stdev_mm": {"F": 1, "d": 1, "h": 1},
    "curvature": {"F": -1, "t": -1},
    "D28_mm": {"F": 1, "t": 1},
    "D0_mm": {"F": 1, "d": 1, "h": 1, "E": -1},
}
"""Output, input: 1 where physics has the output rise with the input, -1 where it has it fall."""

_GRID = 9

ONE_FACTOR = (
    ("base_kPa", "F_rel"),
    ("curvature", "F_rel"),
    ("curvature", "t_mm"),
    ("curvature", "E_ratio"),
    ("amp_kPa", "F_rel"),
    ("amp_kPa", "E_ratio"),
    ("amp_kPa", "d_mm"),
    ("amp_kPa", "h"),
    ("stdev_mm", "F_rel"),
    ("stdev_mm", "E_ratio"),
    ("stdev_mm", "d_mm"),
    ("stdev_mm", "h"),
)
"""The twelve graphs of Figure 13: output, input."""


@dataclass(frozen=True)
class OneFactorCurve:
    """One graph of Figure 13: a relative output against one input, all others as in the reference case.

    `form` is "power" (a x^b) or "stiffness" (a + b E^-2/3). `b_without` is what b becomes without the run at
    `x_without`, on which it depends most.
    """

    output: str
    input: str
    form: str
    x: Floats
    y: Floats
    a: float
    b: float
    r2: float
    b_without: float
    x_without: float

    def __call__(self, x: Floats) -> Floats:
        """The fitted curve at `x`."""
        return self.a + self.b * x ** (-2 / 3) if self.form == "stiffness" else self.a * x**self.b

    def text(self) -> str:
        """The curve in readable form."""
        name = OUTPUT_NAMES[self.output]
        if self.form == "stiffness":
            return f"{name} = {self.a:.3f} {'-' if self.b < 0 else '+'} {abs(self.b):.3f} E^-2/3"
        return f"{name} = {self.a:.3f} {SYMBOL_OF[self.input]}^{self.b:.3f}"

    def without_text(self) -> str:
        """What its exponent, or slope, becomes without one run, and without which."""
        return f"{self.b_without:.3f} without {SYMBOL_OF[self.input]} = {self.x_without:g}"


def one_factor_rows(table: pd.DataFrame, varied: str) -> pd.DataFrame:
    """The runs that differ from the reference case in `varied` alone (t: in d or h alone), in its order."""
    reference = table[table["code"] == REFERENCE_CODE].iloc[0]
    free = {"t_mm": ({"d_mm"}, {"h"})}.get(varied, ({varied},))
    keep = np.zeros(len(table), bool)
    for may_differ in free:
        same = table["linear"].to_numpy(bool).copy()
        for name in ("d_mm", "h", "E_ratio", "F_rel"):
            if name not in may_differ:
                same &= np.isclose(table[name].astype(float), reference[name])
        keep |= same
    return table[keep].sort_values(varied)


def one_factor_curve(table: pd.DataFrame, output: str, varied: str) -> OneFactorCurve:
    """Fit one graph of Figure 13 by least squares in the curve's linear form."""
    rows = one_factor_rows(table, varied)
    x = rows[varied].to_numpy(float)
    y = relative(table).loc[rows.index, output].to_numpy(float)
    stiffness = varied == "E_ratio"
    at, value = (x ** (-2 / 3), y) if stiffness else (np.log(x), np.log(y))
    b, a = np.polyfit(at, value, 1)
    fitted = a + b * at if stiffness else np.exp(a + b * at)
    without = [np.polyfit(np.delete(at, k), np.delete(value, k), 1)[0] for k in range(len(x))]
    most = int(np.argmax(np.abs(without - b)))
    spread = np.ptp(y) > 1e-3 * np.abs(y).max()
    return OneFactorCurve(
        output,
        varied,
        "stiffness" if stiffness else "power",
        x,
        y,
        float(a if stiffness else np.exp(a)),
        float(b),
        r_squared(y, fitted) if spread else 1.0,
        float(without[most]),
        float(x[most]),
    )


@dataclass(frozen=True)
class ForwardEquation:
    """One equation of the forward model, its terms chosen by backward elimination.

    Attributes
    ----------
    output : str
        Column of the table; the equation gives the logarithm of its relative value.
    table : DataFrame
        Coefficient, standard error, t, P and VIF of every term (Appendix B).
    r2, r2_adjusted : float
        Of the logarithm, in sample.
    r2_value : float
        Of the relative value itself.
    steps : list of (term dropped, P value it had, R2 after, adjusted R2 after)
    actual, predicted : arrays
        Relative values of every run (Figure 17).
    wrong_way : dict of str to float
        Input -> share of the runs' range in which the equation goes against `KNOWN_DIRECTIONS` with it.
    """

    output: str
    table: pd.DataFrame
    r2: float
    r2_adjusted: float
    r2_value: float
    steps: list[tuple[str, float, float, float]]
    actual: Floats
    predicted: Floats
    wrong_way: dict[str, float]

    def text(self) -> str:
        """The equation in readable form."""
        return equation_text(f"ln {OUTPUT_NAMES[self.output]}", self.table["coefficient"])

    def wrong_way_text(self) -> str:
        """Where not to trust it: "E in 19 %" of the range goes against physics; "" if nowhere."""
        return ", ".join(f"{name} in {100 * share:.0f} %" for name, share in self.wrong_way.items())


def input_terms(table: pd.DataFrame, output: str) -> pd.DataFrame:
    """Candidate terms: the inputs' logarithms and E^-2/3, their squares and products.

    Curvature takes ln t and one power of the force. It grows without end as the edge of contact comes near
    the places 8 mm from the middle, which a quadratic of ln F can only follow by turning up again at large F.
    """
    terms = _every_term(table, output)
    # The thesis varied the force in the reference geometry only: F d and F h are zero in every run.
    return terms.loc[:, (terms.abs().max() > 1e-9).to_numpy()]


def _every_term(table: pd.DataFrame, output: str) -> pd.DataFrame:
    def log(column: pd.Series) -> pd.Series:
        return pd.Series(np.log(column.astype(float)), index=table.index)

    f: dict[str, pd.Series] = {
        "ln F": log(table["F_rel"]),
        "ln(t/13 mm)": log(table["t_mm"] / 13),
        "ln(d/10 mm)": log(table["d_mm"] / 10),
        "ln(h/.8)": log(table["h"] / 0.8),
        "E^-2/3": table["E_ratio"].astype(float) ** (-2 / 3),
    }
    if output == "curvature":
        powers = {f"F^-{n:g}": np.exp(-n * f["ln F"]) for n in CURVATURE_POWERS if n}
        return pd.DataFrame({"ln F": f["ln F"], **powers, "ln(t/13 mm)": f["ln(t/13 mm)"]})
    # t is made of d and h: each equation takes t, or d and h, never all three.
    far = output in FAR_OUTPUTS
    names = ["ln F", "ln(t/13 mm)"] if far else ["ln F", "ln(d/10 mm)", "ln(h/.8)", "E^-2/3"]
    terms: dict[str, pd.Series] = {name: f[name] for name in names}
    for i, first in enumerate(names):
        for second in names[i:]:
            terms[f"({first})^2" if first == second else f"{first} {second}"] = f[first] * f[second]
    return pd.DataFrame(terms)


def _best_power(terms: pd.DataFrame, y: Floats) -> pd.DataFrame:
    """Curvature's terms with the one power of F, of all in `terms`, that leaves least."""
    t = terms.columns[-1]
    fits = {name: sm.OLS(y, sm.add_constant(terms[[name, t]])).fit().ssr for name in terms.columns[:-1]}
    return terms[[min(fits, key=lambda name: fits[name]), t]]


def wrong_way(coefficients: pd.Series, output: str, table: pd.DataFrame) -> dict[str, float]:
    """Input -> share of the runs' range of F, d, h and E in which an equation defies `KNOWN_DIRECTIONS`.

    Parameters
    ----------
    coefficients : Series
        Of the equation, by term, "1" the first.
    output : str
    table : DataFrame
        The runs, for their ranges.
    """
    E = table["E_ratio"].astype(float) ** (-2 / 3)
    axes = [
        np.linspace(v.min(), v.max(), _GRID) for v in (np.log(table["F_rel"]), table["d_mm"], table["h"], E)
    ]
    ln_F, d, h, E_inv23 = (v.ravel() for v in np.meshgrid(*axes, indexing="ij"))
    grid = pd.DataFrame(
        {"F_rel": np.exp(ln_F), "d_mm": d, "h": h, "E_ratio": E_inv23**-1.5, "t_mm": d * (h + 0.5)}
    )
    terms = _every_term(grid, output)[list(coefficients.index[1:])]
    value = (terms.to_numpy() @ coefficients.to_numpy()[1:]).reshape(4 * (_GRID,))
    out = {}
    for name, sign in KNOWN_DIRECTIONS[output].items():
        if name == "E":
            sign = -sign  # the axis is E^-2/3
        steps = np.diff(value, axis={"F": 0, "d": 1, "t": 1, "h": 2, "E": 3}[name])
        share = float((sign * steps < -1e-9).mean())
        if share:
            out[name] = share
    return out


def forward_equation(table: pd.DataFrame, output: str) -> ForwardEquation:
    """Start from all terms and drop the weakest, by P value, until every one is needed.

    A term stays if its P value is under .05 and the adjusted R2 would fall by more than .001 without it.
    """
    actual = relative(table)[output].to_numpy()
    y = np.log(np.maximum(actual, 1e-6))
    terms = input_terms(table, output)
    if output == "curvature":
        terms = _best_power(terms, y)
    # The base is proportional to F and to nothing else: the thesis gives it no further term.
    X = sm.add_constant(terms[["ln F"]] if output == "base_kPa" else terms).rename(columns={"const": "1"})
    steps: list[tuple[str, float, float, float]] = []
    while True:
        result = sm.OLS(y, X).fit()
        P = result.pvalues.drop("1")
        if len(P) == 1:
            break
        worst = str(P.idxmax())
        after = sm.OLS(y, X.drop(columns=worst)).fit()
        if P[worst] <= P_STAY and result.rsquared_adj - after.rsquared_adj > WORTH:
            break
        X = X.drop(columns=worst)
        steps.append((worst, float(P[worst]), float(after.rsquared), float(after.rsquared_adj)))
    predicted = np.exp(result.fittedvalues.to_numpy())
    return ForwardEquation(
        output,
        coefficient_table(result),
        float(result.rsquared),
        float(result.rsquared_adj),
        r_squared(actual, predicted),
        steps,
        actual,
        predicted,
        wrong_way(result.params, output, table),
    )


def forward_model(table: pd.DataFrame) -> dict[str, ForwardEquation]:
    """The six equations, fitted to the linear runs."""
    return {output: forward_equation(table, output) for output in FEATURES}


def stiffness_transforms(table: pd.DataFrame) -> pd.DataFrame:
    """Evidence for E^-2/3: how straight the amplitude is in each transform, and what leverage E = 1000 gets.

    Returns
    -------
    DataFrame
        One row a transform: its R2 against the relative amplitude over the one-factor runs in E, and the
        largest leverage of any of the runs in a regression on it.
    """
    rows = one_factor_rows(table, "E_ratio")
    E = rows["E_ratio"].to_numpy(float)
    every = table["E_ratio"].to_numpy(float)
    y = relative(table).loc[rows.index, "amp_kPa"].to_numpy()
    forms: dict[str, Callable[[Floats], Floats]] = {
        "E": lambda e: e,
        "log E": np.log,
        "E^-1/3": lambda e: e ** (-1 / 3),
        "E^-1/2": lambda e: e**-0.5,
        "E^-2/3": lambda e: e ** (-2 / 3),
        "E^-5/6": lambda e: e ** (-5 / 6),
        "1/E": lambda e: 1 / e,
    }
    out = []
    for name, form in forms.items():
        result = sm.OLS(y, sm.add_constant(form(E))).fit()
        g = form(every) - form(every).mean()
        leverage = 1 / len(g) + g**2 / np.sum(g**2)
        out.append(
            {"transform": name, "r2": float(result.rsquared), "largest_leverage": float(leverage.max())}
        )
    return pd.DataFrame(out)
