"""Models for the tests: fitted to a smooth made-up law, as large and as curved as the real ones."""

from __future__ import annotations

import hashlib
import math
from itertools import combinations_with_replacement

import numpy as np

from firmware_py import features as firmware_features
from firmware_py import model_image
from palpate.learn.scopes import PILOT_FEATURES
from palpate.model_export.integers.reference import monomials
from palpate.model_export.schema import OUTPUTS, Domain, Interval, Limit, ModelSpec, Output

SIX = ("ln_base", "ln_amp", "ln_stdev", "inv_curvature", "ln_d28", "ln_d0")
RANGES = {
    "F_N_per_m": (5.0, 300.0),
    "t_mm": (2.0, 60.0),
    "d_mm": (2.0, 40.0),
    "h": (0.1, 3.0),
    "E_fat_kPa": (2.0, 50.0),
}


def _strokes(n_features: int, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Correlated features (n x n_features) and targets (n x 6, in the outputs' units) of a made-up law."""
    causes = rng.uniform(-1, 1, (n, 5))
    mix = rng.normal(0, 1, (5, n_features))
    bend = rng.normal(0, 0.35, (5, n_features))
    features = causes @ mix * 0.5 + np.tanh(causes**2 @ bend) + 0.04 * rng.normal(size=(n, n_features))
    features += np.linspace(-3, 6, n_features)
    scale = np.array([0.8, 0.9, 0.7, 0.65, 1.0])
    log_middle = np.log([60.0, 12.0, 9.0, 0.7, 1.0])
    targets = np.exp(log_middle + scale * causes)
    targets[:, 4] = 0.5 + 0.47 * np.tanh(1.5 * causes[:, 4])
    of_the_fat = 10.0 * np.exp(0.4 * np.sin(causes[:, 0] + causes[:, 1]))
    return features, np.column_stack([targets, of_the_fat])


def _ranges(targets: np.ndarray) -> tuple[tuple[float | None, float | None], ...]:
    """What the model is said to be for: nearly all there is; no ends for t, no lower one for E^-2/3."""
    lo, hi = np.quantile(targets, [0.02, 0.98], axis=0).tolist()
    return ((lo[0], hi[0]), (None, None), (lo[2], hi[2]), (lo[3], hi[3]), (None, hi[4]), (None, None))


def model(kind: str = "field", degree: int = 2, seed: int = 1, n: int = 1500) -> ModelSpec:
    """A field model (eleven features, all monomials up to `degree`) or a thesis model (six, few terms)."""
    rng = np.random.default_rng(seed)
    names = PILOT_FEATURES if kind == "field" else SIX
    k = len(names)
    features, targets = _strokes(k, n, rng)
    centre, scale = features.mean(0), features.std(0)
    lo, hi = np.quantile(features, [0.001, 0.999], axis=0)
    margin = 0.05 * (hi - lo)
    z = (np.clip(features, lo - margin, hi + margin) - centre) / scale
    terms = tuple(t for p in range(degree + 1) for t in combinations_with_replacement(range(k), p))
    if kind == "thesis":
        terms = (*terms[: k + 1], (0, 1), (1, 1), (2, 2), (0, 5), (4, 5))
    a = monomials(z, terms)
    ridge = np.diag([1e-3 * 10 ** len(t) for t in terms])
    outputs, links = [], []
    for j, (name, _) in enumerate(OUTPUTS):
        link = "identity" if name == "E_inv23" else "ln"
        y = np.log(targets[:, j]) if link == "ln" else targets[:, j]
        coefficients = np.linalg.solve(a.T @ a + ridge, a.T @ y)
        links.append(a @ coefficients)
        outputs.append(Output(name, link, *RANGES.get(name, (0.0, 1.05)), tuple(coefficients.tolist())))
    linear = ((), *((i,) for i in range(k)))
    sigma = rng.normal(0, 0.15, (len(OUTPUTS), len(linear) + len(OUTPUTS)))
    sigma[:, 0] = -4
    precision = np.linalg.inv(np.cov(z.T) + 0.01 * np.eye(k))
    distance = np.einsum("ni,ij,nj->n", z, precision, z)
    return ModelSpec(
        kind=kind,
        probe=model_image.PROBE.decode(),
        features_version=firmware_features.FEATURES_VERSION,
        features=names,
        centre=tuple(centre.tolist()),
        scale=tuple(scale.tolist()),
        clip_lo=tuple((lo - margin).tolist()),
        clip_hi=tuple((hi + margin).tolist()),
        terms=terms,
        outputs=tuple(outputs),
        interval=Interval(0.9, linear, tuple(map(tuple, sigma.tolist())), ((1.6, 1.8),) * len(OUTPUTS)),
        domain=Domain(
            tuple(lo.tolist()),
            tuple(hi.tolist()),
            (0.0,) * k,
            tuple(map(tuple, ((precision + precision.T) / 2).tolist())),
            float(np.quantile(distance, 0.999)),
            _ranges(targets),
            0.15,
        ),
        lump=(Limit(names[1], lo=float(lo[1] - 1)), Limit("ln_stdev", hi=math.log(20.0) + 9)),
        hard_below=0.3,
        force_range=(10.0, 250.0),
        training={"hash": hashlib.sha256(features.tobytes()).hexdigest(), "n": n, "seed": seed},
    ).validate()
