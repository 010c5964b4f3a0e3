"""Along the valley of a lump's stiffness: a large soft lump feels like a small hard one.

Over balls the posterior is long there, curved, and ends where the stiffness does: its mode may lie far from
its middle. So it is cut into slices. The stiffness is held at one value after another, all others follow to
the likeliest and are normal about it; slices weigh as they are likely (H. Rue, S. Martino, N. Chopin, J. R.
Stat. Soc. B 71, 2009).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.stats import norm

from palpate.inversion.widening import NORMAL

Floats = NDArray[np.float64]

Quantity = Callable[[Floats], tuple[float, Floats]]
"""A number that follows from all unknowns (size,), and its derivatives by them (size,)."""

TAILS = 0.05, 0.5, 0.95
"""What lies below the ends of an interval, and below its middle."""
_FINE, _VALUES = 161, 801
_FAR = 5.0
_LEAST_SD = 1e-9


class Spread(NamedTuple):
    """The median of a posterior, and how far it reaches below and above: sds, or half an interval."""

    middle: float
    below: float
    above: float


def sum_of(weights: Floats) -> Quantity:
    """The sum of the unknowns by weights (size,)."""
    return lambda z: (float(weights @ z), weights)


@dataclass(frozen=True)
class Valley:
    """Slices through a posterior.

    Attributes
    ----------
    at : ndarray (n,)
        What is held, ascending.
    logs : ndarray (n,)
        The logarithm of its density there.
    z : ndarray (n, size)
        The likeliest guesses.
    covariances : ndarray (n, size, size)
        Laplace's, of what is not held.
    """

    at: Floats
    logs: Floats
    z: Floats
    covariances: Floats

    def turned(self, T: Floats) -> Valley:
        """Of other unknowns, T times these."""
        return Valley(self.at, self.logs, self.z @ T.T, T @ self.covariances @ T.T)

    @property
    def log_evidence(self) -> float:
        """Of all of it: the density's logarithm, summed up."""
        if len(self.at) == 1:
            return float(self.logs[0])
        fine, logs = self._along(self.logs)
        return float(np.logaddexp.reduce(logs) + np.log(fine[1] - fine[0]))

    def spread(self, of: Quantity) -> Spread:
        """Of what follows from the unknowns, linear about each slice's likeliest guess."""
        each = [of(z) for z in self.z]
        middles, weights = np.array([value for value, _ in each]), np.array([steep for _, steep in each])
        sds = np.sqrt(np.einsum("ni,nij,nj->n", weights, self.covariances, weights))
        share = np.ones(1)
        if len(self.at) > 1:
            _, logs, middles, sds = self._along(self.logs, middles, sds)
            share = np.exp(logs - logs.max())
        sds = np.maximum(sds, _LEAST_SD)
        values = np.linspace((middles - _FAR * sds).min(), (middles + _FAR * sds).max(), _VALUES)
        below = share / share.sum() @ norm.cdf((values - middles[:, None]) / sds[:, None])
        low, middle, high = np.interp(TAILS, below, values)
        return Spread(float(middle), float(middle - low) / NORMAL, float(high - middle) / NORMAL)

    def _along(self, *values: Floats) -> list[Floats]:
        """Many places from one end to the other, and values (n,) of the slices there."""
        fine = np.linspace(self.at[0], self.at[-1], _FINE)
        return [fine, *(PchipInterpolator(self.at, of)(fine) for of in values)]
