"""A Gaussian process for one smooth number of many inputs: a straight line, and what departs from it.

Rasmussen & Williams, Gaussian Processes for Machine Learning (2006): equations 2.25, 5.8 and 5.9; Matern's
covariance with nu = 5/2, a length for each input. The lengths are those of greatest posterior density.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.optimize import minimize

from palpate.features.map_features import Floats
from palpate.sim.tissue.one_thread import one_blas_thread

MOST = 400
"""Rows, drawn at random, that the lengths are found from; all rows then share them."""

_STEPS = 50
_USUAL_LN_LENGTH, _SPREAD_LN_LENGTH = 1.5, 1.2
"""Before any row is seen: over four spreads of an input nothing much bends."""
_LN_LENGTHS, _LN_SIZE, _LN_NOISE = (-1.5, 5.0), (-4.0, 4.0), (-7.0, 1.0)
_SMOOTH_LN_LENGTHS = (0.7, _LN_LENGTHS[1])
_LEAST_NOISE = 1e-8
_LINE = 1e-4
"""Ridge on the straight line, over the number of rows."""
_AT_ONCE = 2000
"""Rows that are predicted together: their covariances take memory."""


@dataclass(frozen=True)
class GaussianProcess:
    """Fitted by `fit_process`.

    Attributes
    ----------
    centre, scale : (inputs,)
    line : (1 + inputs,)
    unit : float
        Size of what departs from the line.
    theta : (inputs + 2,)
        ln of the size, of the lengths, and of the noise, in units of `unit`.
    z : (rows, inputs)
        What it was fitted to, standardised.
    weights : (rows,)
    """

    centre: Floats
    scale: Floats
    line: Floats
    unit: float
    theta: Floats
    z: Floats
    weights: Floats

    def predict(self, x: Floats) -> Floats:
        """Values, (n,), at inputs x (n, inputs)."""
        z = (x - self.centre) / self.scale
        parts = [z[k : k + _AT_ONCE] for k in range(0, len(z), _AT_ONCE)]
        bent = [_covariance(part, self.z, self.theta) @ self.weights for part in parts]
        out: Floats = _line(z) @ self.line + self.unit * np.concatenate(bent)
        return out

    def with_slopes(self, x: Floats) -> tuple[Floats, Floats]:
        """Values (n,) at inputs x (n, inputs) and their derivatives by them, (n, inputs)."""
        z = (x - self.centre) / self.scale
        lengths, b, of_b = self._scaled
        a = z / lengths * np.sqrt(5)
        r = a @ (-2 * b.T)
        r += (a**2).sum(1)[:, None]
        r += of_b
        np.sqrt(np.maximum(r, 0.0, out=r), out=r)
        size = np.exp(-r) * (self.weights * np.exp(2 * self.theta[0]))
        steep = size * r
        size += steep
        steep *= r
        values = _line(z) @ self.line + self.unit * (size.sum(1) + steep.sum(1) / 3)
        bent = (size @ b - a * size.sum(1)[:, None]) * (np.sqrt(5) / 3 / lengths)
        return values, (self.line[1:] + self.unit * bent) / self.scale

    @cached_property
    def _scaled(self) -> tuple[Floats, Floats, Floats]:
        """Lengths; what it was fitted to over them, times the root of 5; its rows' squares."""
        lengths = np.exp(self.theta[1:-1])
        b = self.z / lengths * np.sqrt(5)
        return lengths, b, (b**2).sum(1)


@one_blas_thread()
def fit_process(x: Floats, y: Floats, seed: int = 0, smooth: Collection[int] = ()) -> GaussianProcess:
    """Learn y (n,) as a function of x (n, inputs); the same seed finds the same lengths.

    Parameters
    ----------
    smooth : collection of int
        Inputs that nothing bends over less than two spreads of.
    """
    centre, scale = x.mean(0), x.std(0) + 1e-9
    z = (x - centre) / scale
    A = _line(z)
    ridge = np.diag([1e-9, *[_LINE * len(z)] * z.shape[1]])
    line = np.linalg.solve(A.T @ A + ridge, A.T @ y).astype(np.float64)
    left = y - A @ line
    unit = float(left.std()) + 1e-12
    left = left / unit
    some = np.random.default_rng(seed).permutation(len(z))[:MOST]
    theta = _most_likely(z[some], left[some], smooth)
    K = _covariance(z, z, theta)
    K[np.diag_indices_from(K)] += _noise(theta)
    weights = cho_solve(cho_factor(K, lower=True, overwrite_a=True), left)
    return GaussianProcess(centre, scale, line, unit, theta, z, weights)


def _line(z: Floats) -> Floats:
    return np.column_stack([np.ones(len(z)), z])


def _noise(theta: Floats) -> float:
    return float(np.exp(2 * theta[-1])) + _LEAST_NOISE


def _covariance(a: Floats, b: Floats, theta: Floats) -> Floats:
    """(rows of a, rows of b), without noise."""
    return _matern(_apart(a, b, theta), theta)


def _apart(a: Floats, b: Floats, theta: Floats) -> Floats:
    """Distances (rows of a, rows of b) in lengths, times the root of 5."""
    lengths = np.exp(theta[1:-1])
    a, b = a / lengths, b / lengths
    squared = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
    out: Floats = np.sqrt(5 * np.maximum(squared, 0.0))
    return out


def _matern(r: Floats, theta: Floats) -> Floats:
    out: Floats = np.exp(2 * theta[0] - r) * (1 + r + r * r / 3)
    return out


def _most_likely(z: Floats, y: Floats, smooth: Collection[int]) -> Floats:
    n, inputs = z.shape
    diagonal = np.diag_indices(n)

    def loss(theta: Floats) -> tuple[float, Floats]:
        """-ln of the posterior density, and its gradient."""
        r = _apart(z, z, theta)
        K = _matern(r, theta)
        with_noise = K.copy()
        with_noise[diagonal] += _noise(theta)
        factor, failed = dpotrf(with_noise, lower=True, clean=True)
        if failed:
            return 1e9, np.zeros_like(theta)
        lower, _ = dpotri(factor, lower=True)
        inverse = lower + np.tril(lower, -1).T
        a = inverse @ y
        W = inverse - np.outer(a, a)
        slope = W * (np.exp(2 * theta[0] - r) * (5 / 3) * (1 + r))
        by_squares = slope.sum(1) @ z**2 - ((slope @ z) * z).sum(0)
        off = (theta[1:-1] - _USUAL_LN_LENGTH) / _SPREAD_LN_LENGTH
        gradient = np.empty_like(theta)
        gradient[0] = (W * K).sum()
        gradient[1:-1] = np.exp(-2 * theta[1:-1]) * by_squares + off / _SPREAD_LN_LENGTH
        gradient[-1] = np.trace(W) * np.exp(2 * theta[-1])
        return float(0.5 * y @ a + np.log(np.diag(factor)).sum() + 0.5 * off @ off), gradient

    start = np.array([0.0, *[_USUAL_LN_LENGTH] * inputs, -3.0])
    lengths = [_SMOOTH_LN_LENGTHS if k in smooth else _LN_LENGTHS for k in range(inputs)]
    bounds = [_LN_SIZE, *lengths, _LN_NOISE]
    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": _STEPS})
    theta: Floats = found.x
    return theta
