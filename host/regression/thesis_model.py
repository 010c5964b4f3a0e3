"""The thesis kind for the probe: its forward model, learned from the 29 runs, turned round into a polynomial.

A probe cannot search for the inputs that explain its features best, as `inverted.py` does. So the search is
done beforehand: the forward quadratics are evaluated on thousands of inputs within the runs' ranges, noise as
the sensors make it is added, and a log-polynomial learns the way back. Its intervals come from the runs
themselves, each left out of forward model and polynomial in turn (jackknife).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from host.features import Floats
from host.regression.conformal import LEVEL, Widths, conformal_quantile, fit_sigma
from host.regression.domain import fit_domain
from host.regression.inverted import quadratic
from host.regression.probe_model import (
    Polynomial,
    fit_polynomial,
    from_link,
    shows_lump,
    spec_of,
    to_link,
    training_hash,
)
from host.regression.ridge import all_terms
from host.regression.seen import Seen, join, look, noise_named
from host.regression.table import r_squared
from host.regression.watch import Watch
from model_export.schema import OUTPUTS, ModelSpec
from sim.probe.sensors import Noise, StrokeField
from sim.tissue import FORCE_UNIT_N_PER_M, Stroke

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
"""What the thesis' six measure, in the forms that noise hurts least, and where the pressure's centre moves.

With the thesis' own six E^-2/3 comes out at an R2 of .3 on random lumps at typical noise, with these at .65.
"""

DEGREE = 2
DRAWS = 4
IMAGINED = 4096
_RIDGE = 1e-2
_D_MM, _H, _E, _F = (5.0, 20.0), (0.3, 1.5), (2.0, 1000.0), (0.2, 1.0)
_T_MM = (4.0, 40.0)


@dataclass(frozen=True)
class _Forward:
    """Features as quadratics of z = (ln F, ln d/10, ln h/.8, E^-2/3), and what noise does to them."""

    coefficients: Floats
    scatter: Floats

    def imagine(self, z: Floats, rng: np.random.Generator) -> Floats:
        return quadratic(z) @ self.coefficients + self.scatter[rng.integers(len(self.scatter), size=len(z))]


def fit_thesis_model(
    strokes: Sequence[Stroke],
    seed: int = 1,
    noise: Noise | str = "typical",
    draws: int = DRAWS,
    watch: Watch | None = None,
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
    watch : callable, optional
        See `watch.Watch`.
    """
    runs = [s for s in strokes if s.case.has_lump and not s.case.nonlinear_lump]
    level = noise_named(noise).without("force")
    fields = [StrokeField(s) for s in runs]
    seen_each = []
    for k in range(draws):
        if watch is not None:
            watch("runs seen through the sensors", k + 1, draws)
        seen_each.append(look(fields, level, seed + k))
    seen = join(seen_each)
    seen = seen.take(seen.whole)
    model = _inverse(seen, seed)
    widths = _widths(seen, model, seed)
    X, imagined_Y, _ = _imagined(seen, seed)
    domain = fit_domain(X, model.standard(X))
    estimate = from_link(model.predict(seen.columns(FEATURES)))
    scores = {name: r_squared(seen.Y[:, j], estimate[:, j]) for j, (name, _) in enumerate(OUTPUTS)}
    return spec_of(
        "thesis",
        model,
        widths,
        domain,
        (float(seen.Y[:, 0].min()) * 0.8, float(seen.Y[:, 0].max()) * 1.2),
        {
            "hash": training_hash(seen.X, seen.Y),
            "n": len(seen),
            "runs": len(runs),
            "noise": noise if isinstance(noise, str) else "custom",
            "seed": seed,
            "features": seen.columns(FEATURES).tolist(),
        },
        notes={"r2_in_sample": scores, "imagined": len(imagined_Y)},
    )


def _z(Y: Floats) -> Floats:
    return np.column_stack(
        [np.log(Y[:, 0] / FORCE_UNIT_N_PER_M), np.log(Y[:, 2] / 10), np.log(Y[:, 3] / 0.8), Y[:, 4]]
    )


def _forward(seen: Seen) -> _Forward:
    X, A = seen.columns(FEATURES), quadratic(_z(seen.Y))
    scale = X.std(axis=0)
    penalty = np.diag(
        np.r_[np.zeros(5), np.full(A.shape[1] - 5, _RIDGE * len(A) / len(np.unique(seen.group)))]
    )
    B = np.linalg.solve(A.T @ A + penalty, A.T @ (X / scale)) * scale
    return _Forward(B, X - A @ B)


def _imagined(seen: Seen, seed: int) -> tuple[Floats, Floats, Floats]:
    """Features, outputs on the link scale, and values of lumps that the forward model imagines."""
    u = qmc.Sobol(4, seed=np.random.default_rng(seed)).random(IMAGINED)
    E0, E1 = (e ** (-2 / 3) for e in _E)
    F = _F[0] + (_F[1] - _F[0]) * u[:, 0]
    d = _D_MM[0] + (_D_MM[1] - _D_MM[0]) * u[:, 1]
    h = _H[0] + (_H[1] - _H[0]) * u[:, 2]
    E_inv23 = E1 + (E0 - E1) * u[:, 3]
    Y = np.column_stack([F * FORCE_UNIT_N_PER_M, d * (h + 0.5), d, h, E_inv23])
    X = _forward(seen).imagine(_z(Y), np.random.default_rng(seed))
    keep = shows_lump(X, FEATURES)
    return X[keep], to_link(Y[keep]), Y[keep]


def _inverse(seen: Seen, seed: int) -> Polynomial:
    X, Y, _ = _imagined(seen, seed)
    lo = to_link(
        np.array(
            [[0.8 * _F[0] * FORCE_UNIT_N_PER_M, _T_MM[0], 0.9 * _D_MM[0], 0.9 * _H[0], _E[1] ** (-2 / 3)]]
        )
    )
    hi = to_link(
        np.array(
            [[1.2 * _F[1] * FORCE_UNIT_N_PER_M, _T_MM[1], 1.1 * _D_MM[1], 1.1 * _H[1], _E[0] ** (-2 / 3)]]
        )
    )
    terms = all_terms(len(FEATURES), DEGREE)
    return fit_polynomial(FEATURES, X, Y, np.arange(len(X)), terms, lo[0], hi[0])


def _widths(seen: Seen, model: Polynomial, seed: int) -> Widths:
    """Widths whose shape comes from the imagined lumps and whose size from the runs, each left out once."""
    X, Y, _ = _imagined(seen, seed + 1)
    predicted = model.predict(X)
    terms, coefficients = fit_sigma(model.standard(X), predicted, Y - predicted, np.arange(len(X)))
    unit = Widths(terms, coefficients, np.ones((Y.shape[1], 2)), LEVEL)
    scores = []
    for run in np.unique(seen.group):
        out = seen.group == run
        left = _inverse(seen.take(~out), seed)
        x = seen.columns(FEATURES)[out]
        y = left.predict(x)
        scores.append(np.abs(to_link(seen.Y[out]) - y) / unit.sigma(model.standard(x), model.predict(x)))
    all_scores = np.concatenate(scores)
    quantiles = np.array([[conformal_quantile(s, LEVEL)] * 2 for s in all_scores.T])
    return Widths(terms, coefficients, quantiles, LEVEL)
