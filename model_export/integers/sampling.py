"""Random feature vectors inside a model's declared domain."""

from __future__ import annotations

import math

import numpy as np

from palpate.model_export.errors import ModelError
from palpate.model_export.integers import reference
from palpate.model_export.schema import ModelSpec


def in_domain(spec: ModelSpec, n: int, seed: int = 1) -> np.ndarray:
    """n vectors (n x features, feature units, whole Q24 numbers) inside box and distance, estimates in range.

    Directions are those of the domain's ellipsoid, radii lean outwards, and the box cuts what it cuts.
    """
    rng = np.random.default_rng(seed)
    axes = np.linalg.cholesky(np.linalg.inv(np.array(spec.domain.precision)))
    lo, hi = (np.array(v) * 2**24 for v in (spec.domain.lo, spec.domain.hi))
    middle = np.array(spec.domain.centre)
    found: list[np.ndarray] = []
    for _ in range(200):
        direction = rng.normal(size=(n, len(spec.features)))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        radius = np.sqrt(rng.uniform(0, 1, (n, 1))) * math.sqrt(spec.domain.threshold)
        z = middle + radius * direction @ axes.T
        whole = np.round((np.array(spec.centre) + z * spec.scale) * 2**24)
        x = np.clip(whole, np.ceil(lo), np.floor(hi)) / 2**24
        away = (x - spec.centre) / spec.scale - middle
        distance = np.einsum("ni,ij,nj->n", away, np.array(spec.domain.precision), away)
        x = x[distance <= spec.domain.threshold]
        found.append(x[~reference.evaluate(spec, x)["beyond"].any(axis=1)] if len(x) else x)
        if sum(map(len, found)) >= n:
            return np.vstack(found)[:n]
    raise ModelError(
        "the model's domain is empty: its box, its distance and its ranges leave nothing in common"
    )
