"""The forward model turned round: quadratics of the inputs, solved for the inputs by least squares.

Each feature is a quadratic of z = (ln F, ln d/10 mm, ln h/.8, E^-2/3). A stroke's estimate is the z whose
features are nearest to those measured, each in units of its residual, held lightly to the ranges of the
runs. The thesis tried to invert its forward equations one by one and dropped it; least squares over all
features at once is what makes it work.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from palpate.features.map_features import Floats
from palpate.learn.table import TARGETS, coordinates, further_outputs

RIDGE = 1e-3
_LOW = np.array([np.log(0.15), np.log(0.4), np.log(0.3), 0.0])
_HIGH = np.array([np.log(1.1), np.log(2.2), np.log(2.0), 0.75])
_MIDDLE, _SPREAD = np.array([-0.5, 0.0, 0.0, 0.25]), np.array([2.0, 2.0, 2.0, 0.8])
_STARTS = np.array([[-0.36, 0, 0, 0.1], [-0.36, 0, 0, 0.5], [-0.7, 0.5, -0.5, 0.2], [-0.7, -0.5, 0.4, 0.2]])
_PAIRS = [(i, j) for i in range(4) for j in range(i, 4)]
_SIGMA_FLOOR = 0.003
_SCALE = {"dip": 5.0}


def inputs_z(table: pd.DataFrame) -> Floats:
    """(n, 4): ln F, ln d/10 mm, ln h/.8 and E^-2/3 of each run."""
    return np.column_stack(
        [
            np.log(table["F_rel"].astype(float)),
            np.log(table["d_mm"].astype(float) / 10),
            np.log(table["h"].astype(float) / 0.8),
            table["E_ratio"].astype(float) ** (-2 / 3),
        ]
    )


def targets_of(z: Floats) -> pd.DataFrame:
    """F, t, d, h and E^-2/3 of inputs z (n, 4)."""
    F, d, h, E_inv23 = np.exp(z[:, 0]), 10 * np.exp(z[:, 1]), 0.8 * np.exp(z[:, 2]), z[:, 3]
    values = {"F": F, "t": d * (h + 0.5), "d": d, "h": h, "E_inv23": E_inv23}
    return pd.DataFrame({**values, **further_outputs(F, d, h, E_inv23)})[list(TARGETS)]


def quadratic(z: Floats) -> Floats:
    """(n, 15): 1, z and their products two by two."""
    return np.column_stack([np.ones(len(z)), z, *(z[:, i] * z[:, j] for i, j in _PAIRS)])


def _slope(z: Floats) -> Floats:
    """(n, 15, 4): derivative of `quadratic`."""
    out = np.zeros((len(z), 15, 4))
    out[:, 1:5] = np.eye(4)
    for row, (i, j) in enumerate(_PAIRS, start=5):
        out[:, row, i] += z[:, j]
        out[:, row, j] += z[:, i]
    return out


@dataclass(frozen=True)
class ForwardQuadratics:
    """The features as quadratics of the inputs, and how far off each is.

    Attributes
    ----------
    features : names of `coordinates` columns
    coefficients : (15, n_features)
    sigma : (n_features), root mean square residual, not below .003
    """

    features: tuple[str, ...]
    coefficients: Floats
    sigma: Floats

    @classmethod
    def fit(
        cls, z: Floats, outputs: pd.DataFrame, features: Sequence[str], ridge: float = RIDGE
    ) -> ForwardQuadratics:
        """Least squares, the second-order terms held back by a small ridge (29 runs, 15 terms)."""
        A, Y = quadratic(z), _observed(outputs, features)
        penalty = np.diag(np.r_[np.zeros(5), np.full(10, ridge)])
        B = np.linalg.solve(A.T @ A + penalty, A.T @ Y)
        left = np.sqrt(np.mean((Y - A @ B) ** 2, axis=0))
        return cls(tuple(features), B, np.maximum(left, _SIGMA_FLOOR))

    def predict(self, z: Floats) -> pd.DataFrame:
        """Feature coordinates of inputs z (n, 4)."""
        Y = quadratic(z) @ self.coefficients
        return pd.DataFrame({name: Y[:, k] / _SCALE.get(name, 1.0) for k, name in enumerate(self.features)})

    def invert(self, outputs: pd.DataFrame) -> Floats:
        """(n, 4): the inputs z that explain each row of feature coordinates best."""
        Y = _observed(outputs, self.features)
        best, cost = np.tile(_MIDDLE, (len(Y), 1)), np.full(len(Y), np.inf)
        for start in _STARTS:
            z, c = self._descend(np.tile(np.clip(start, _LOW, _HIGH), (len(Y), 1)), Y)
            better = c < cost
            best[better], cost[better] = z[better], c[better]
        return best

    def _misfit(self, z: Floats, Y: Floats) -> Floats:
        return np.hstack([(quadratic(z) @ self.coefficients - Y) / self.sigma, (z - _MIDDLE) / _SPREAD])

    def _descend(self, z: Floats, Y: Floats, steps: int = 60) -> tuple[Floats, Floats]:
        """Levenberg-Marquardt on all rows at once; a step that leaves the box is clipped to it."""
        r = self._misfit(z, Y)
        cost, damping = (r * r).sum(1), np.full(len(z), 1e-2)
        prior = np.broadcast_to(np.diag(1 / _SPREAD), (len(z), 4, 4))
        for _ in range(steps):
            J = np.concatenate(
                [np.einsum("nqi,qf->nfi", _slope(z), self.coefficients / self.sigma), prior], axis=1
            )
            H, g = np.einsum("nfi,nfj->nij", J, J), np.einsum("nfi,nf->ni", J, r)
            # On the box's edge a coordinate that pushes outwards is frozen, lest it hold the others back.
            frozen = ((z <= _LOW) & (g > 0)) | ((z >= _HIGH) & (g < 0))
            H = np.where(frozen[:, :, None] | frozen[:, None, :], 0.0, H)
            diagonal = np.einsum("nii->ni", H) * (1 + damping[:, None]) + frozen
            H[:, range(4), range(4)] = diagonal
            step = np.linalg.solve(H, -np.where(frozen, 0.0, g)[..., None])[..., 0]
            trial = np.clip(z + np.clip(step, -0.7, 0.7), _LOW, _HIGH)
            rt = self._misfit(trial, Y)
            ct = (rt * rt).sum(1)
            good = ct <= cost
            z = np.where(good[:, None], trial, z)
            r = np.where(good[:, None], rt, r)
            gain = cost - np.minimum(ct, cost)
            cost = np.minimum(ct, cost)
            damping = np.where(good, damping * 0.3, damping * 6).clip(1e-9, 1e9)
            if (gain <= 1e-12 * cost).all() and (good | (damping > 1e6)).all():
                break
        return z, cost


def _observed(outputs: pd.DataFrame, features: Sequence[str]) -> Floats:
    return np.column_stack([outputs[name].to_numpy(float) * _SCALE.get(name, 1.0) for name in features])


def inverted_estimates(
    table: pd.DataFrame, features: Sequence[str], leave_one_out: bool = False
) -> pd.DataFrame:
    """Targets of every run by the inverted forward model; leave-one-out refits it without the run."""
    z, outputs = inputs_z(table), coordinates(table)
    if not leave_one_out:
        return targets_of(ForwardQuadratics.fit(z, outputs, features).invert(outputs))
    rows = []
    for k in range(len(table)):
        rest = np.arange(len(table)) != k
        model = ForwardQuadratics.fit(z[rest], outputs[rest], features)
        rows.append(model.invert(outputs.iloc[[k]])[0])
    return targets_of(np.array(rows))
