"""The posterior's mode by Levenberg-Marquardt.

Steps solve (H + D) dz = -g with the Gauss-Newton matrix H = A^T A of all weighted residuals, g = A^T r, and D
on the tissue's and the lump's own numbers only (Marquardt 1963): all others enter almost linearly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.forward import Computed, Forward
from palpate.inversion.posterior import Misfit, Posterior
from palpate.sim.tissue import CaseError, StrokeError

Floats = NDArray[np.float64]

_TRIES = 5
_SOFTER, _HARDER = 0.2, 10.0
_LITTLE = 1e-3


@dataclass
class Mode:
    """Where a search has ended.

    Attributes
    ----------
    z : ndarray
        All unknowns.
    covariance : ndarray
        Laplace's, of all unknowns.
    misfit : Misfit
    dof : float
        Data less what the unknowns have taken up of them.
    settled : bool
        Whether no step promised more.
    log_evidence : float
        Laplace's approximation, but for a constant that all classes share.
    """

    z: Floats
    covariance: Floats
    misfit: Misfit
    dof: float
    settled: bool
    steps: int
    log_evidence: float

    @property
    def chi2(self) -> float:
        """Of the data alone, for each degree of freedom."""
        return float((self.misfit.data**2).sum() / self.dof)


def search(
    posterior: Posterior,
    forward: Forward,
    z: Floats,
    most: int,
    enough: float = 1.0,
    damping: float = 0.02,
    hopeless: float = np.inf,
) -> Mode:
    """Go down from z in `most` steps, until the next one promises less than `enough` of the misfit.

    hopeless : float
        A misfit that is over this after four steps is not followed further.

    Raises
    ------
    CaseError, StrokeError
        The first guess cannot be computed.
    """
    found = _computed(posterior, forward, z)
    misfit, settled, steps = posterior.misfit(z, found), False, 0
    while True:
        A, B = posterior.jacobian(z, found, *forward.differentiated(found))
        H = A.T @ A + B.T @ B
        g = A.T @ misfit.data.ravel() + B.T @ misfit.prior
        if settled or steps >= most or (steps >= 4 and misfit.total > hopeless):
            break
        taken = False
        for _ in range(_TRIES):
            step = _step(posterior, z, H, g, damping)
            promised = -(2 * g @ step + step @ H @ step)
            if promised < enough:
                settled = True
                break
            try:
                other = _computed(posterior, forward, z + step)
            except (CaseError, StrokeError):
                damping = max(damping, _LITTLE) * _HARDER
                continue
            there = posterior.misfit(z + step, other)
            gained = misfit.total - there.total
            if gained > 0:
                damping *= _SOFTER if gained > 0.3 * promised else 2.0
                z, found, misfit, taken = z + step, other, there, True
                settled = gained < enough
                break
            damping = max(damping, _LITTLE) * _HARDER
        if not taken:
            break
        steps += 1
    covariance: Floats = np.linalg.inv(H).astype(np.float64)
    dof = posterior.measured - float(np.trace(covariance @ (A.T @ A)))
    known = np.isfinite(posterior.sd)
    evidence = -0.5 * (misfit.total + np.linalg.slogdet(H)[1]) - float(np.log(posterior.sd[known]).sum())
    return Mode(z, covariance, misfit, dof, settled, steps, evidence)


def _computed(posterior: Posterior, forward: Forward, z: Floats) -> Computed:
    return forward(z[posterior.at["tissue"]], posterior.places(z), posterior.forces(z))


def _step(posterior: Posterior, z: Floats, H: Floats, g: Floats, damping: float) -> Floats:
    """A damped step; what would leave its range stays at its end, and a long step is shortened."""
    of = posterior.of
    k = len(of.unknowns)
    low, high, longest, sd = (of.column(name) for name in ("low", "high", "step", "sd"))
    M = H.copy()
    own = np.arange(k)
    M[own, own] += damping * (np.diag(H)[own] + 10 / sd**2)
    free = np.ones(len(z), bool)
    step = np.zeros(len(z))
    for _ in range(k):
        step[:] = 0.0
        step[free] = np.linalg.solve(M[np.ix_(free, free)], -g[free])
        pushed = ((z[:k] <= low) & (step[:k] < 0)) | ((z[:k] >= high) & (step[:k] > 0))
        if not (pushed & free[:k]).any():
            break
        free[:k] &= ~pushed
    step /= max(1.0, float(np.abs(step[:k] / longest).max()))
    step[:k] = np.clip(z[:k] + step[:k], low, high) - z[:k]
    return step
