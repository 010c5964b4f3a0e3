"""What a program says beside a value, learned from data that the model was not fitted to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.space import Array, Atom

INSIDE = 0.99
"""Of the calibration set: what lies within the domain's distance."""


@dataclass(frozen=True)
class Calibration:
    """Split-conformal half-widths on the link scale, and what the features were like.

    Attributes
    ----------
    half_widths : list of float
    ends : list of (float, float)
        Least and greatest of each feature.
    X : array (n, features)
    """

    half_widths: list[float]
    ends: list[tuple[float, float]]
    X: Array

    @staticmethod
    def of(X: Array, y: Array, predicted: Array, links: Sequence[str], level: float) -> Calibration:
        """From calibration data: y and predicted are n x outputs, in the outputs' units."""
        if not 0 < level < 1:
            raise CompileError(f"level must lie between 0 and 1, not {level:g}")
        if len(X) != len(y) or y.shape != predicted.shape:
            raise CompileError(f"calibrate has {len(X)} rows of X and y of shape {y.shape}; they must fit")
        if not np.isfinite(y).all():
            raise CompileError("calibrate has a y that is not finite")
        rank = math.ceil((len(X) + 1) * level)
        if rank > len(X):
            raise CompileError(
                f"{len(X)} rows are too few to calibrate {100 * level:g} % intervals; "
                f"{math.ceil(level / (1 - level))} are the least"
            )
        widths = []
        for k, link in enumerate(links):
            true, said = y[:, k], predicted[:, k]
            if link == "exp":
                if (true <= 0).any():
                    raise CompileError(
                        "calibrate has a y that is not positive, which a logarithm cannot take"
                    )
                true, said = np.log(true), np.log(said)
            widths.append(float(np.sort(np.abs(true - said))[rank - 1]))
        return Calibration(widths, list(zip(X.min(axis=0).tolist(), X.max(axis=0).tolist())), X)

    def coordinates(self, atoms: Sequence[tuple[int, Atom]]) -> list[tuple[Array, float]]:
        """Rows (coefficients of the first k atoms' z, offset) whose squares add up to 1 at its edge."""
        z = np.stack([(self.X[:, a.feature] - a.centre) / a.radius for _, a in atoms], axis=1)
        middle = z.mean(axis=0)
        covariance = np.atleast_2d(np.cov(z.T)) + 1e-6 * np.eye(len(atoms))
        lower = np.linalg.inv(np.linalg.cholesky(covariance))
        far = np.sort(((z - middle) @ lower.T).__pow__(2).sum(axis=1))
        rows = lower / math.sqrt(far[min(math.ceil(INSIDE * len(far)), len(far) - 1)])
        return [(rows[k, : k + 1], float(-rows[k, : k + 1] @ middle[: k + 1])) for k in range(len(atoms))]
