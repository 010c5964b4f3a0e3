"""A fit over a solid lump and the regression's estimate of the same stroke, weighed by what each may be off.

The fit errs by its emulator and by where its search ends, the regression by what its features leave out: over
computed lumps the two errors hardly go together. With the mode z of covariance C, widened, and the estimate
y = H z + e, e of covariance R, the two together are [1]

    z' = z + K (y - H z),    C' = (1 - K H) C,    K = C H^T (H C H^T + R)^-1

Where they contradict each other by more than both allow, C and R are taken larger until they do not [2].

[1] R. Kalman, *A new approach to linear filtering and prediction problems*, J. Basic Eng. 82 (1960).
[2] R. Birge, *The calculation of errors by the method of least squares*, Phys. Rev. 40 (1932).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.joint import Together
from palpate.inversion.search import Mode
from palpate.inversion.solid_classes import HEIGHT, WIDTH
from palpate.inversion.start import Start

Floats = NDArray[np.float64]

_ALIKE = np.array([
    [1.0, -0.8, 0.35, 0.6, 0.0], [-0.8, 1.0, 0.0, -0.75, 0.1], [0.35, 0.0, 1.0, 0.0, 0.2],
    [0.6, -0.75, 0.0, 1.0, 0.1], [0.0, 0.1, 0.2, 0.1, 1.0],
])  # fmt: skip
"""How the estimate's errors in ln d, ln h, ln t, E^-2/3 and ln E go together, over 228 kept lumps."""
_FRESH = 1.4
"""So much larger they are over lumps that the regression was not fitted to, on another mesh."""
_MODEL = {"ln d": 0.025, WIDTH: 0.05, HEIGHT: 0.05, "ln depth": 0.025, "E^-2/3": 0.02, "ln_E": 0.025}
"""Standard deviations of what mesh and emulator, set right, get wrong, by unknown."""


def pooled(posterior: Together, mode: Mode, start: Start) -> Mode:
    """The mode with its spread widened, and with the estimate weighed in where both are of a lump.

    Parameters
    ----------
    posterior : Together
        Of strokes over one lump under a solid class.
    """
    mode = widened(posterior, mode)
    if not start.sd or not posterior.of.lump:
        return mode
    z, C = mode.z, mode.covariance
    said, H = _as_said(posterior, z)
    apart = np.array([np.log(start.d_mm), np.log(start.depth_mm / start.d_mm), np.log(start.t_mm),
                      start.E_inv23, np.log(start.E_kPa)]) - said  # fmt: skip
    S = H @ C @ H.T + _ALIKE * np.outer(start.sd, start.sd) * _FRESH**2
    square = float(apart @ np.linalg.solve(S, apart))
    more = max(1.0, square / len(apart))
    K = np.linalg.solve(S, H @ C).T
    evidence = -0.5 * (square / more + np.linalg.slogdet(more * S)[1])
    return replace(
        mode, z=z + K @ apart, covariance=more * (C - K @ H @ C), log_evidence=mode.log_evidence + evidence
    )


def widened(posterior: Together, mode: Mode) -> Mode:
    """The mode, its spread with what emulator and mesh get wrong."""
    at = {unknown.name: k for k, unknown in enumerate(posterior.of.unknowns)}
    at["ln_E"] = posterior.at["ln_E"].start
    C = mode.covariance.copy()
    for name, sd in _MODEL.items():
        if name in at:
            C[at[name], at[name]] += sd**2
    return replace(mode, covariance=C)


def _as_said(posterior: Together, z: Floats) -> tuple[Floats, Floats]:
    """What the mode says of the estimate's numbers, (5,), and their derivatives by z, (5, size)."""
    at = {unknown.name: k for k, unknown in enumerate(posterior.of.unknowns)}
    case = posterior.of.case(z[: len(at)])
    d, depth, E = at["ln d"], at["ln depth"], posterior.at["ln_E"].start
    H = np.zeros((5, len(z)))
    H[0, d] = H[1, depth] = H[3, at["E^-2/3"]] = H[4, E] = 1.0
    H[1, d] = -1.0
    down = case.half_down / case.t_mm
    H[2, depth], H[2, d] = case.depth_mm / case.t_mm, down
    if HEIGHT in at:
        H[2, at[HEIGHT]] = down
    said = np.log([case.d_mm, case.h, case.t_mm, 1.0, 1.0])
    said[3:] = case.E_inv23, z[E]
    return said, H
