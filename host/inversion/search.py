"""The posterior's mode by Levenberg-Marquardt.

Steps solve (H + D) dz = -g with the Gauss-Newton matrix H = A^T A of all weighted residuals, g = A^T r, and D
on the tissue's and the lump's own numbers only (Marquardt 1963): all others enter almost linearly. After a
small step that kept its promise Broyden's update brings the derivatives up to date, frame by frame; after
all others they are computed anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.forward import Predicted, Predicts, Slopes
from palpate.inversion.joint import Together
from palpate.inversion.posterior import Misfit, Posterior
from palpate.inversion.steps import Steps
from palpate.inversion.valley import Quantity, Spread, Valley
from palpate.sim.tissue import CaseError, StrokeError

Floats = NDArray[np.float64]

_TRIES = 4
_FLAT = 5.0
"""No step gains although this much is promised: the contact's nodes make the misfit ripple by so much."""
_SOFTER, _HARDER = 0.2, 10.0
_LITTLE = 1e-3
_KEEPS = 0.5
_NEAR = 400.0
"""Derivatives stay, but for Broyden's update, while steps keep so much of a promise that is no larger."""
_WORSE, _LEAST_WORSE = {0: np.inf, 1: np.inf, 2: 1e4, 3: 1e3, 4: 1e3}, 200.0
"""After so many steps, and more, a misfit so much over another mode's will not come down to it."""


class Sides(NamedTuple):
    """Standard deviations of an unknown below and above its mode."""

    below: float
    above: float


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
        Whether an undamped step would promise nothing that counts.
    log_evidence : float
        Laplace's approximation, but for a constant that all classes share.
    found, slopes : Predicted, Slopes
        The frames there and their derivatives.
    jacobian : ndarray (n (rows + 1), size)
        Of the weighted residuals of the data.
    sides : mapping of Sides
        Of unknowns whose marginals were worked out, by name (`marginal.with_sides`).
    valley : Valley, optional
        Where the posterior was cut into slices.
    """

    z: Floats
    covariance: Floats
    misfit: Misfit
    dof: float
    settled: bool
    steps: int
    log_evidence: float
    found: Predicted
    slopes: Slopes
    jacobian: Floats
    sides: Mapping[str, Sides] = field(default_factory=dict)
    valley: Valley | None = None

    def own(self, T: Floats) -> Mode:
        """Of other unknowns (m,), T (m, size) times these."""
        valley = self.valley and self.valley.turned(T)
        return replace(self, z=T @ self.z, covariance=T @ self.covariance @ T.T, valley=valley)

    @property
    def whole_evidence(self) -> float:
        """Of the whole valley, where the posterior was cut along one."""
        return self.log_evidence if self.valley is None else self.valley.log_evidence

    def spread(self, of: Quantity) -> Spread:
        """Of what follows from the unknowns; without a valley the mode is its middle."""
        if self.valley is not None:
            return self.valley.spread(of)
        value, weights = of(self.z)
        sd = float(np.sqrt(weights @ self.covariance @ weights))
        return Spread(value, sd, sd)

    @property
    def chi2(self) -> float:
        """Of the data alone, for each degree of freedom."""
        return float((self.misfit.data**2).sum() / self.dof)


def search(
    posterior: Posterior | Together,
    forward: Predicts,
    z: Floats,
    most: int,
    enough: float = 1.0,
    damping: float = 0.02,
    hopeless: float = np.inf,
    best: float = np.inf,
    least: float = 0.0,
    stride: float = 1.0,
    held: int | None = None,
) -> Mode:
    """Go down from z in `most` steps, until an undamped one promises less than `enough` of the misfit.

    hopeless : float
        A misfit that is over this after four steps is not followed further.
    best : float
        Another mode's misfit; one that stays far over it is not followed further either.
    least : float
        A step that gains less is the last.
    stride : float
        Over the unknowns' own longest steps.
    held : int, optional
        An unknown that stays as it is; covariance and evidence are the others'.

    Raises
    ------
    CaseError, StrokeError
        The first guess cannot be computed, or its misfit is no number.
    """
    found = _computed(posterior, forward, z)
    misfit, slopes, exact, settled, steps = posterior.misfit(z, found), forward.slopes(found), True, False, 0
    if not np.isfinite(misfit.total):
        raise CaseError("the misfit of the first guess is no number")
    while True:
        A, B = posterior.jacobian(z, found, slopes)
        H = A.T @ A + B.T @ B
        g = A.T @ misfit.data.ravel() + B.T @ misfit.prior
        steps_of = Steps(posterior, z, H, g, stride, held)
        undamped = _promise(steps_of(0.0), H, g)
        settled = undamped < enough
        far = misfit.total - best > _WORSE.get(steps, _LEAST_WORSE)
        if settled or steps >= most or far or (steps >= 4 and misfit.total > hopeless):
            break
        before, last, taken, good, promised = found, misfit.total, False, False, np.inf
        for _ in range(_TRIES if exact else 2):
            step = steps_of(damping)
            promised = _promise(step, H, g)
            try:
                other = _computed(posterior, forward, z + step)
            except (CaseError, StrokeError):
                damping = max(damping, _LITTLE) * _HARDER
                continue
            there = posterior.misfit(z + step, other)
            gained = misfit.total - there.total
            if gained > 0:
                good = gained > _KEEPS * promised
                damping *= _SOFTER if good else 2.0
                z, found, misfit, taken = z + step, other, there, True
                break
            damping = max(damping, _LITTLE) * _HARDER
        if taken and good and promised < _NEAR and found.on_mesh_of(before):
            slopes, exact = slopes.secant(before, found, forward.scale), False
        elif taken or not exact:
            slopes, exact = forward.slopes(found), True
        else:
            settled = undamped < _FLAT
            break
        steps += taken
        if taken and last - misfit.total < least:
            break
    free = np.flatnonzero(np.arange(len(z)) != held)
    own = np.ix_(free, free)
    covariance = np.zeros(H.shape)
    covariance[own] = np.linalg.inv(H[own])
    dof = posterior.measured - float(np.trace(covariance @ (A.T @ A)))
    known = np.isfinite(posterior.sd)
    evidence = -0.5 * (misfit.total + np.linalg.slogdet(H[own])[1]) - float(np.log(posterior.sd[known]).sum())
    return Mode(z, covariance, misfit, dof, settled, steps, evidence, found, slopes, A)


def _computed(posterior: Posterior | Together, forward: Predicts, z: Floats) -> Predicted:
    return forward(z[posterior.at["tissue"]], posterior.places(z), posterior.forces(z))


def _promise(step: Floats, H: Floats, g: Floats) -> float:
    """How much of the misfit a step would take if all were linear."""
    return -float(2 * g @ step + step @ H @ step)
