"""Rounding a row's coefficients together: each one's error is compensated by those that follow.

Features of a stroke are correlated, so many changes of the coefficients hardly change a prediction. Rounded
coefficients that differ from the exact ones by such a change are better than the nearest ones. (The greedy
search is Babai's nearest plane.)
"""

from __future__ import annotations

import numpy as np

from palpate.fixedpoint.word_pairs import Floats, Integers

DAMPING = 1e-9  # of the mean square of an input


class Rounding:
    """For rows over the same inputs.

    Parameters
    ----------
    inputs : array (n, k)
        The inputs of the sums at n vectors of the domain; the last column is the intercept's, which is not
        rounded.
    order : array of int
        In which order the columns are rounded, the last column last.
    """

    def __init__(self, inputs: Floats, order: Integers) -> None:
        self.order = order
        ordered = inputs[:, order]
        square = ordered.T @ ordered / len(inputs)
        square += DAMPING * np.trace(square) / len(square) * np.eye(len(square))
        # U of inv(square) = U^T U, by the factor of the square turned about: the inverse of a nearly singular
        # square need not be positive definite to the last bit, and then has no factor of its own.
        turned = np.linalg.cholesky(square[::-1, ::-1])
        self.upper = np.linalg.inv(turned)[::-1, ::-1]

    def whole(self, coefficients: Floats, fraction: int) -> Floats:
        """The coefficients in whole numbers of 2^-fraction; the intercept's change likewise, not rounded."""
        left = coefficients[self.order] * 2.0**fraction
        for k in range(len(left) - 1):
            error = left[k] - np.round(left[k])
            left[k] -= error
            left[k + 1 :] -= error / self.upper[k, k] * self.upper[k, k + 1 :]
        out = np.empty(len(left))
        out[self.order] = left
        return out


class Nearest:
    """Each coefficient for itself: where there are so many that rounding them together would take minutes."""

    def whole(self, coefficients: Floats, fraction: int) -> Floats:
        """As `Rounding.whole`."""
        left = coefficients * 2.0**fraction
        left[:-1] = np.round(left[:-1])
        return left
