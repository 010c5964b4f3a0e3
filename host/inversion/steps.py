"""Levenberg-Marquardt's steps within the ranges of the unknowns.

Ranges are kept by the active set method (J. Nocedal, S. Wright, *Numerical Optimization*, 2006, ch. 16.5).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.joint import Together
from palpate.inversion.posterior import Posterior

Floats = NDArray[np.float64]

_AT_END = 1e-9
"""So near the end of its range, by its spread beforehand, an unknown has no room."""
_PULLED = 1e-6
"""The misfit's slope, by the same spread, that pulls one back from its end."""


class Steps:
    """Damped steps from a guess: all but the tissue's and the lump's own numbers are eliminated once.

    What would leave its range stays at its end, the others go on from there (the active set method): no step
    is worse than none by the matrix. A long one is shortened.

    Parameters
    ----------
    posterior : Posterior or Together
    z : ndarray (size,)
        The guess; a step brings what lies outside its range to the end.
    H, g : ndarray
        The Gauss-Newton matrix (size, size) and half the misfit's gradient (size,) there.
    stride : float
        Over the unknowns' own longest steps.
    held : int, optional
        An unknown that stays as it is.
    """

    def __init__(
        self,
        posterior: Posterior | Together,
        z: Floats,
        H: Floats,
        g: Floats,
        stride: float,
        held: int | None,
    ) -> None:
        of = posterior.of
        k = len(of.unknowns)
        self._z, self._k, self._held = z, k, held
        self._low, self._high, self._sd = (of.column(name) for name in ("low", "high", "sd"))
        self._longest = stride * of.column("step")
        rest = np.arange(k, len(z))
        self._rest = rest[rest != held]
        across = H[self._rest, :k]
        led = np.linalg.solve(H[np.ix_(self._rest, self._rest)], np.column_stack([across, g[self._rest]]))
        self._led, self._alone = -led[:, :k], -led[:, k]
        self._H = H[:k, :k] + across.T @ self._led
        self._g = g[:k] + across.T @ self._alone
        self._damps = np.diag(H)[:k] + 10 / self._sd**2

    def __call__(self, damping: float) -> Floats:
        """The step (size,) with so much damping of the tissue's and the lump's own numbers."""
        own = self._own(self._H + damping * np.diag(self._damps))
        step = np.zeros(len(self._z))
        step[: self._k] = own
        step[self._rest] = self._alone + self._led @ own
        step /= max(1.0, float(np.abs(own / self._longest).max()))
        z = self._z[: self._k]
        step[: self._k] = np.clip(z + step[: self._k], self._low, self._high) - z
        return step

    def _own(self, M: Floats) -> Floats:
        """Of the tissue and the lump (k,): the least of their matrix's parabola within the ranges."""
        k, step = self._k, np.zeros(self._k)
        z = self._z[:k]
        low, high = np.minimum(self._low - z, 0.0), np.maximum(self._high - z, 0.0)
        movable = np.arange(k) != self._held
        free = movable.copy()
        for _ in range(4 * k):
            more = np.zeros(k)
            more[free] = np.linalg.solve(M[np.ix_(free, free)], -(self._g + M @ step)[free])
            room = np.where(more > 0, high, low) - step
            ended = (more != 0) & (np.abs(room) <= _AT_END * self._sd)
            if ended.any():
                free &= ~ended
                continue
            share = np.divide(room, more, out=np.full(k, np.inf), where=more != 0).min()
            step += min(share, 1.0) * more
            if share >= 1.0:
                down = -(self._g + M @ step)
                inward = np.where(step > (low + high) / 2, -down, down)
                inward[free | ~movable] = 0.0
                if not (inward * self._sd > _PULLED).any():
                    break
                free[np.argmax(inward * self._sd)] = True
        return step
