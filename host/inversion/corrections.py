"""What the solver says otherwise than an emulator: of the guesses that it was asked about, and between them.

Of one guess it is a smooth function of place and force, and so is how it turns with each unknown. Between
guesses each one's is carried on along its turns and the nearer ones count for more (D. Shepard, Proc. ACM
1968). Units: mm, forces as ln F/E.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

END_MM = 50.0
"""So far away nothing changes any more."""
_ALL, _ALONG = 0.01, ((0.004, 1.2), (0.004, 2.5), (0.005, 10.0))
_LN_F = 0.8
_OF_THE_MESH = 0.0003
"""The spreads of corrections: of all frames alike, along the stroke by mm, by the logarithm of the force, and
of what the contact's nodes make of a single frame."""
_SQUARE = _ALL**2 + sum(sd**2 for sd, _ in _ALONG)
"""A correction's variance."""
_LARGER = 0.1, 0.3, 1.0, 2.0, 4.0, 8.0
"""So much larger they may be, all alike: as is likeliest."""
_THERE = 1e-4
"""Guesses so near, squared and by the unknowns' spreads, are one."""
_RIPPLE = 0.04
"""The same of steps that tell nothing of how corrections turn: the mesh moves, too."""


class Turned(NamedTuple):
    """How values (n, q) of frames (n,) turn with k unknowns, (n, q, k)."""

    places_mm: Floats
    ln_F: Floats
    by: Floats


class Smooth(NamedTuple):
    """A Gaussian process through values (m, q) of frames (m,).

    Attributes
    ----------
    weights : ndarray (m, q)
        Of the covariances with its frames.
    times, spread : float
        So much larger corrections are along the frames, and all variances.
    root : ndarray (m, m)
        Of the values' covariances, by Cholesky.
    """

    places_mm: Floats
    ln_F: Floats
    weights: Floats
    times: float
    spread: float
    root: Floats

    def off(self, places_mm: Floats, ln_F: Floats) -> float:
        """How far off values of other frames (n,) still are, in the root mean square."""
        own = self.times**2 * _SQUARE + _OF_THE_MESH**2
        K = _kernel(self.places_mm, self.ln_F, places_mm, ln_F)[0]
        known = (np.linalg.solve(self.root, self.times**2 * K) ** 2).sum(0)
        return float(np.sqrt((self.spread * (own - known)).mean()))


class Corrections:
    """Corrections of q values a frame.

    Parameters
    ----------
    sd : ndarray (k,)
        The unknowns' spreads beforehand, by which guesses are near.
    """

    def __init__(self, sd: Floats, q: int) -> None:
        k = len(sd)
        self._sd = sd
        self._places, self._ln_F = np.empty(0), np.empty(0)
        self._thetas = np.empty((0, k))
        # weights of the covariances with the frames above: (guesses, frames, q) and their turns
        self._weights, self._turns = np.empty((0, 0, q)), np.empty((0, 0, q, k))

    def away(self, theta: Floats) -> float:
        """How far a guess is from the nearest one, by the unknowns' spreads; infinite where there is none."""
        return float(np.sqrt(self._apart(theta)[1].min(initial=np.inf)))

    def __call__(self, theta: Floats, places_mm: Floats, ln_F: Floats) -> tuple[Floats, Floats]:
        """Of frames (n,) of a guess, and derivatives by place and ln F, (3, n, q); by unknowns (n, q, k)."""
        values, by, turns = self._between(theta)
        K = _kernel(places_mm, ln_F, self._places, self._ln_F)
        n, q, k = len(places_mm), *by.shape[1:]
        steep = K[0] @ (by + turns).reshape(-1, q * k)
        return np.array([part @ values for part in K]), steep.reshape(n, q, k)

    def add(
        self, theta: Floats, places_mm: Floats, ln_F: Floats, wrong: Floats, turned: Turned | None
    ) -> Smooth:
        """The solver's word on a guess, made smooth.

        Parameters
        ----------
        wrong : ndarray (n, q)
            What it says otherwise of some frames (n,) than the emulator.
        turned : Turned, optional
            And how that turns with the unknowns; else as other guesses say.
        """
        known, _, turns = self._between(theta)
        here = places_mm, ln_F
        smooth = _smoothed(here, _kernel(*here, *here)[0], wrong - self._covariance(*here) @ known)
        more = smooth.weights
        if turned is None:
            by = more[..., None] * self._way(theta)
        else:
            there = turned.places_mm, turned.ln_F
            apart = np.moveaxis(turned.by - np.tensordot(self._covariance(*there), turns, 1), -1, 0)
            K = _kernel(*there, *there)[0]
            steep = np.stack([_smoothed(there, K, part).weights for part in apart], -1)
            by = np.concatenate([np.zeros((*more.shape, len(theta))), steep])
            more = np.concatenate([more, np.zeros(steep.shape[:2])])
            places_mm, ln_F = (np.append(*pair) for pair in zip(here, there))
        frames = len(places_mm)
        self._places, self._ln_F = np.append(self._places, places_mm), np.append(self._ln_F, ln_F)
        self._thetas = np.vstack([self._thetas, theta])
        self._weights, self._turns = (
            np.concatenate([_longer(old, frames), np.concatenate([base, new])[None]])
            for old, base, new in ((self._weights, known, more), (self._turns, turns, by))
        )
        return smooth

    def _covariance(self, places_mm: Floats, ln_F: Floats) -> Floats:
        """With all frames asked so far, (n, frames)."""
        return _kernel(places_mm, ln_F, self._places, self._ln_F)[0]

    def _way(self, theta: Floats) -> Floats:
        """By which a guess's corrections turn as they do from the nearest one's (C. Broyden 1965), (k,)."""
        if not len(self._thetas):
            return np.zeros(len(theta))
        steps, squares = self._apart(theta)
        nearest = squares.argmin()
        out: Floats = steps[nearest] / self._sd**2 / (squares[nearest] + _RIPPLE)
        return out

    def _apart(self, theta: Floats) -> tuple[Floats, Floats]:
        """Steps from the guesses (guesses, k), and their squares by the unknowns' spreads, (guesses,)."""
        steps = theta - self._thetas
        return steps, ((steps / self._sd) ** 2).sum(1)

    def _between(self, theta: Floats) -> tuple[Floats, Floats, Floats]:
        """Weights of a guess (frames, q), what mixing adds to their turns, (frames, q, k), and the turns."""
        steps, squares = self._apart(theta)
        near = 1.0 / (squares + _THERE)
        share = near**2 / (near**2).sum()
        by = -4.0 * near[:, None] * steps / self._sd**2
        by = share[:, None] * (by - share @ by)
        each = self._weights + np.einsum("gmqk,gk->gmq", self._turns, steps)
        return (
            np.tensordot(share, each, 1),
            np.einsum("gk,gmq->mqk", by, each),
            np.tensordot(share, self._turns, 1),
        )


def _longer(old: Floats, frames: int) -> Floats:
    """Weights of guesses with none for frames that were asked later."""
    return np.pad(old, [(0, 0), (0, frames), *[(0, 0)] * (old.ndim - 2)])


def _kernel(x: Floats, ln_F: Floats, x2: Floats, ln_F2: Floats) -> tuple[Floats, Floats, Floats]:
    """Covariances (n, m) of corrections, and their derivatives by the first place and force."""
    u, v = (np.clip(one, -END_MM, END_MM) for one in (x[:, None], x2))
    moves = np.where(np.abs(x) < END_MM, 1.0, 0.0)[:, None]
    apart = u - v
    shapes = [(sd**2 * np.exp(-((apart / length) ** 2) / 2), length) for sd, length in _ALONG]
    along = _ALL**2 + sum(shape for shape, _ in shapes)
    slope = moves * sum(-apart / length**2 * shape for shape, length in shapes)
    off = (ln_F[:, None] - ln_F2) / _LN_F
    force = np.exp(-(off**2) / 2)
    return along * force, slope * force, -along * force * off / _LN_F


def _smoothed(here: tuple[Floats, Floats], K: Floats, values: Floats) -> Smooth:
    """Through values (m, q) of frames (m,), whose covariances are K (m, m), as smooth as is likeliest."""
    best = np.inf, Smooth(*here, values, 1.0, 1.0, K)
    for times in _LARGER:
        L = np.asarray(np.linalg.cholesky(times**2 * K + _OF_THE_MESH**2 * np.eye(len(K))), float)
        weights = np.linalg.solve(L.T, np.linalg.solve(L, values))
        spread = float((values * weights).mean()) + 1e-30
        unlikely = len(K) * float(np.log(spread)) + 2 * float(np.log(np.diag(L)).sum())
        if unlikely < best[0]:
            best = unlikely, Smooth(*here, times**2 * weights, times, spread, L)
    return best[1]
