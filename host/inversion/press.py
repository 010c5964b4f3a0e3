"""Inverting a press alone. It tells less than a stroke: several lumps may explain it, so each is looked for.

The intervals hold those of every lump that explains the press about as well as the best.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.answer.fitted import Inverted
from palpate.inversion.classes import Class
from palpate.inversion.felt import FeltStroke
from palpate.inversion.forward import COARSE, FINE
from palpate.inversion.posterior import FINE_MESH, USUAL_MESH, Posterior
from palpate.inversion.result import of_modes, told
from palpate.inversion.search import Mode, search
from palpate.inversion.start import Start, first_guess
from palpate.inversion.under import AUTO, LUMPS, classes_over, forward_of, odds_of
from palpate.inversion.widening import WIDER_PRESS
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue import CaseError, StrokeError
from palpate.sim.tissue.one_thread import one_blas_thread

_FRAMES = 6
_STEPS, _FINE_STEPS = 12, 5
_STARTS = ((0.6, 0.6), (1.0, 1.0), (1.6, 1.0), (1.6, 2.0))
"""Diameters and depths of first guesses, over the guess of the middle."""
_AS_WELL = 6.0
"""A lump whose misfit is within so much of the best one's may be the one."""

Found = tuple[Posterior, Mode]


@one_blas_thread()
def invert_press(press: FeltStroke, noise: Noise, kind: str = AUTO) -> Inverted:
    """Invert a press; as `palpate.inversion.strokes.invert_stroke`."""
    some = _thinned(press)
    begin = first_guess(some)
    found = {of.name: modes for of in classes_over(press, kind) if (modes := _modes(of, some, begin, noise))}
    if not found:
        return Inverted(
            press.stroke,
            problem=f"press {press.stroke}: no class of tissue and lump could be computed",
            press=True,
        )
    odds = odds_of((name, mode.log_evidence) for name, modes in found.items() for _, mode in modes)
    best = max(odds, key=lambda name: odds[name])
    if best in LUMPS and LUMPS[-1] in found:
        best = LUMPS[-1]
    least = min(mode.misfit.total for _, mode in found[best])
    near = [_finer(*one) for one in found[best] if one[1].misfit.total < least + 3 * _AS_WELL]
    least = min(mode.misfit.total for _, mode in near)
    near = [one for one in near if one[1].misfit.total <= least + _AS_WELL]
    near.sort(key=lambda one: one[1].chi2)
    posterior, mode = near[0]
    said = of_modes(
        [told(*one, odds, wider=WIDER_PRESS) for one in near], [other.log_evidence for _, other in near]
    )
    return replace(said, laid=(posterior.laid(mode.z, mode.found),))


def _modes(of: Class, press: FeltStroke, begin: Start, noise: Noise) -> list[Found]:
    """Where searches from several starts end, each lump once."""
    modes: list[Found] = []
    for size, depth in _STARTS if of.name in LUMPS else _STARTS[:1]:
        start = replace(begin, d_mm=begin.d_mm * size, depth_mm=begin.depth_mm * depth)
        posterior = Posterior(of, press, noise, USUAL_MESH)
        try:
            z = posterior.start(start.theta(of), start.E_kPa, start.lump_mm)
            mode = search(posterior, forward_of(of, COARSE, [press]), z, _STEPS, enough=0.5)
        except (CaseError, StrokeError):
            continue
        at = posterior.at["tissue"]
        spread = np.sqrt(np.diag(mode.covariance)[at])
        if all((np.abs(mode.z[at] - other.z[at]) > 0.3 * spread).any() for _, other in modes):
            modes.append((posterior, mode))
    return modes


def _finer(posterior: Posterior, mode: Mode) -> Found:
    """Go on upon the fine mesh; as before where that fails."""
    other = Posterior(posterior.of, posterior.stroke, posterior.noise, FINE_MESH)
    other.mean[other.at["start"]] = posterior.mean[posterior.at["start"]]
    try:
        forward = forward_of(posterior.of, FINE, [posterior.stroke])
        return other, search(other, forward, mode.z.copy(), _FINE_STEPS, enough=0.5, damping=1e-3)
    except (CaseError, StrokeError):
        return posterior, mode


def _thinned(press: FeltStroke) -> FeltStroke:
    """Some frames, evenly spread over the force."""
    force = press.rows_kPa.sum(1)
    wanted = np.linspace(force.min(), force.max(), _FRAMES + 1)[1:]
    chosen = np.unique([int(np.abs(force - F).argmin()) for F in wanted])
    return press.take(chosen, np.empty(0, np.int64))
