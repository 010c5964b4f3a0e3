"""What a program says beside a value, learned from data that the model was not fitted to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.fixedpoint import data
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
    level : float
    """

    half_widths: list[float]
    ends: list[tuple[float, float]]
    X: Array
    level: float

    @staticmethod
    def of(
        calibrate: Any,
        features: int,
        columns: Sequence[str] | None,
        reference: Callable[[Array], Array],
        links: Sequence[str],
        level: float,
    ) -> Calibration:
        """From calibration data.

        Parameters
        ----------
        calibrate : (X, y)
            n x features, and n or n x outputs, in their units.
        features : int
        columns : list of str, or None
            The features' names, where the model has data with names.
        reference : callable
            What the model gives in float64 for X.
        """
        if not isinstance(calibrate, tuple | list) or len(calibrate) != 2:
            raise CompileError("calibrate must be a pair: features, and the target's values")
        X, theirs = data.table(calibrate[0], "calibrate")
        if X.shape[1] != features or (columns and theirs and list(theirs) != list(columns)):
            raise CompileError("calibrate has other columns than X")
        y, predicted = data.numbers(calibrate[1], "calibrate's y"), reference(X)
        y = y[:, None] if y.ndim == 1 else y
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
        return Calibration(widths, list(zip(X.min(axis=0).tolist(), X.max(axis=0).tolist())), X, level)

    def ellipsoid(self, atoms: Sequence[tuple[int, Atom]]) -> tuple[Array, Array, float]:
        """The middle of the atoms' z, a lower triangle that makes them independent, its edge squared."""
        z = np.stack([(self.X[:, a.feature] - a.centre) / a.radius for _, a in atoms], axis=1)
        middle = z.mean(axis=0)
        covariance = np.atleast_2d(np.cov(z.T)) + 1e-6 * np.eye(len(atoms))
        lower = np.linalg.inv(np.linalg.cholesky(covariance))
        far = np.sort(((z - middle) @ lower.T).__pow__(2).sum(axis=1))
        edge = float(far[min(math.ceil(INSIDE * len(far)), len(far) - 1)])
        if edge < 1e-9:
            raise CompileError("calibrate has constant features; give data that vary as the device's will")
        return middle, lower, edge

    def coordinates(self, atoms: Sequence[tuple[int, Atom]]) -> list[tuple[Array, float]]:
        """Rows (coefficients of the first k atoms' z, offset) whose squares add up to 1 at its edge."""
        middle, lower, edge = self.ellipsoid(atoms)
        rows = lower / math.sqrt(edge)
        return [(rows[k, : k + 1], float(-rows[k, : k + 1] @ middle[: k + 1])) for k in range(len(atoms))]
