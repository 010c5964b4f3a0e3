"""The thesis kind for the probe: its forward model, learned from the 29 runs, inverted into a polynomial.

A probe cannot search for the inputs that explain its features best, as `inverted.py` does. So the search is
done beforehand: the forward quadratics are evaluated on thousands of inputs within the runs' ranges, noise as
the sensors make it is added, and a log-polynomial learns the inverse. Its intervals come from the runs
themselves, each left out of forward model and polynomial in turn (jackknife).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from palpate.features.map_features import Floats
from palpate.learn.conformal import LEVEL, Widths, conformal_quantile, fit_sigma
from palpate.learn.domain import fit_domain
from palpate.learn.observed import Observed, joined, noise_named, observe
from palpate.learn.probe_model import (
    Polynomial,
    fit_polynomial,
    from_link,
    shows_lump,
    spec_of,
    to_link,
    training_hash,
)
from palpate.learn.ridge import all_terms
from palpate.learn.table import TARGETS, further_outputs, r_squared
from palpate.learn.thesis.inverted import quadratic
from palpate.model_export.schema import OUTPUTS, ModelSpec
from palpate.progress import ProgressCallback
from palpate.sim.probe.sensors import Noise, StrokeField
from palpate.sim.tissue import FORCE_UNIT_N_PER_M, Stroke

FEATURES = (
    "ln_base",
    "asinh_amp",
    "ln_stdev",
    "ln_d_far",
    "dip_6_10",
    "ln_centre_share",
    "tilt_3_5",
    "tilt_6_9",
    "tilt_10_14",
)
"""What the thesis' six measure, in the forms least affected by noise, and how the centre of pressure moves.

With the thesis' own six E^-2/3 comes out at an R2 of .3 on random lumps at typical noise, with these at .65.
"""

DEGREE = 2
DRAWS = 4
EXAMPLES = 4096
_RIDGE = 1e-2
_D_MM, _H, _E, _F = (5.0, 20.0), (0.3, 1.5), (2.0, 1000.0), (0.2, 1.0)
_T_MM = (4.0, 40.0)


@dataclass(frozen=True)
class _Forward:
    """Features as quadratics of z = (ln F, ln d/10, ln h/.8, E^-2/3), and what noise does to them."""

    coefficients: Floats
    scatter: Floats

    def draw(self, z: Floats, rng: np.random.Generator) -> Floats:
        return quadratic(z) @ self.coefficients + self.scatter[rng.integers(len(self.scatter), size=len(z))]


def fit_thesis_model(
    strokes: Sequence[Stroke],
    seed: int = 1,
    noise: Noise | str = "typical",
    draws: int = DRAWS,
    progress: ProgressCallback | None = None,
) -> ModelSpec:
    """The model that `palpate fit --kind thesis` writes.

    Parameters
    ----------
    strokes : sequence of Stroke
        The thesis' runs; nonlinear ones are left out, as in the thesis.
    seed : int
    noise : Noise or name
        How good the sensors are. The runs have one force each, so the hand is taken as steady.
    draws : int
        Probes that stroke each run.
    progress : callable, optional
        See `progress.ProgressCallback`.
    """
    runs = [s for s in strokes if s.case.has_lump and not s.case.nonlinear_lump]
    level = noise_named(noise).at_one_force()
    fields = [StrokeField(s) for s in runs]
    observed_each = []
    for k in range(draws):
        if progress is not None:
            progress("runs observed through the sensors", k + 1, draws)
        observed_each.append(observe(fields, level, seed + k))
    observed = joined(observed_each)
    observed = observed.take(observed.whole)
    model = _inverse(observed, seed)
    widths = _widths(observed, model, seed)
    X, example_Y, _ = _examples(observed, seed)
    domain = fit_domain(X, model.standard(X))
    true = _true(observed)
    estimate = from_link(model.predict(observed.features(FEATURES)))
    scores = {
        name: r_squared(true[:, j], estimate[:, j]) for j, (name, _) in enumerate(OUTPUTS[: len(TARGETS)])
    }
    return spec_of(
        "thesis",
        model,
        widths,
        domain,
        (float(true[:, 0].min()) * 0.8, float(true[:, 0].max()) * 1.2),
        {
            "hash": training_hash(observed.X, observed.truth),
            "n": len(observed),
            "runs": len(runs),
            "noise": Path(noise).name if isinstance(noise, str) else "custom",
            "seed": seed,
            "features": observed.features(FEATURES).tolist(),
        },
        notes={"r2_in_sample": scores, "examples": len(example_Y)},
        fat_kPa=runs[0].case.fat_kPa,
    )


def _true(observed: Observed) -> Floats:
    """Outputs but E_fat, which this model is told, in the units of the wire."""
    return observed.values[:, : len(TARGETS)]


def _z(Y: Floats) -> Floats:
    return np.column_stack(
        [np.log(Y[:, 0] / FORCE_UNIT_N_PER_M), np.log(Y[:, 2] / 10), np.log(Y[:, 3] / 0.8), Y[:, 4]]
    )


def _forward(observed: Observed) -> _Forward:
    X, A = observed.features(FEATURES), quadratic(_z(_true(observed)))
    scale = X.std(axis=0)
    penalty = np.diag(
        np.r_[np.zeros(5), np.full(A.shape[1] - 5, _RIDGE * len(A) / len(np.unique(observed.group)))]
    )
    B = np.linalg.solve(A.T @ A + penalty, A.T @ (X / scale)) * scale
    return _Forward(B, X - A @ B)


def _examples(observed: Observed, seed: int) -> tuple[Floats, Floats, Floats]:
    """Features, outputs on the link scale, and values of lumps, drawn from the forward model."""
    u = qmc.Sobol(4, seed=np.random.default_rng(seed)).random(EXAMPLES)
    E0, E1 = (e ** (-2 / 3) for e in _E)
    F = _F[0] + (_F[1] - _F[0]) * u[:, 0]
    d = _D_MM[0] + (_D_MM[1] - _D_MM[0]) * u[:, 1]
    h = _H[0] + (_H[1] - _H[0]) * u[:, 2]
    E_inv23 = E1 + (E0 - E1) * u[:, 3]
    further = further_outputs(F, d, h, E_inv23).values()
    Y = np.column_stack([F * FORCE_UNIT_N_PER_M, d * (h + 0.5), d, h, E_inv23, *further])
    X = _forward(observed).draw(_z(Y), np.random.default_rng(seed))
    keep = shows_lump(X, FEATURES)
    return X[keep], to_link(Y[keep]), Y[keep]


def _inverse(observed: Observed, seed: int) -> Polynomial:
    X, Y, values = _examples(observed, seed)
    lo = [0.8 * _F[0] * FORCE_UNIT_N_PER_M, _T_MM[0], 0.9 * _D_MM[0], 0.9 * _H[0], _E[1] ** (-2 / 3)]
    hi = [1.2 * _F[1] * FORCE_UNIT_N_PER_M, _T_MM[1], 1.1 * _D_MM[1], 1.1 * _H[1], _E[0] ** (-2 / 3)]
    lo += (0.9 * values[:, len(lo) :].min(axis=0)).tolist()
    hi += (1.1 * values[:, len(hi) :].max(axis=0)).tolist()
    ends = to_link(np.array([lo, hi]))
    terms = all_terms(len(FEATURES), DEGREE)
    return fit_polynomial(FEATURES, X, Y, np.arange(len(X)), terms, *ends)


def _widths(observed: Observed, model: Polynomial, seed: int) -> Widths:
    """Widths whose shape comes from the drawn examples and whose size from the runs, each left out once."""
    X, Y, _ = _examples(observed, seed + 1)
    predicted = model.predict(X)
    terms, coefficients = fit_sigma(model.standard(X), predicted, Y - predicted, np.arange(len(X)))
    unit = Widths(terms, coefficients, np.ones((Y.shape[1], 2)), LEVEL)
    scores = []
    for run in np.unique(observed.group):
        out = observed.group == run
        left = _inverse(observed.take(~out), seed)
        x = observed.features(FEATURES)[out]
        y = left.predict(x)
        left_over = np.abs(observed.truth[out, : len(TARGETS)] - y)
        scores.append(left_over / unit.sigma(model.standard(x), model.predict(x)))
    all_scores = np.concatenate(scores)
    quantiles = np.array([[conformal_quantile(s, LEVEL)] * 2 for s in all_scores.T])
    return Widths(terms, coefficients, quantiles, LEVEL)
