"""Modes of the emulator, followed with what the solver says otherwise there, until it has no more to say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.forward import Emulates
from palpate.inversion.found import Assemble, Found, distinct
from palpate.inversion.joint import Together
from palpate.inversion.posterior import FINE_MESH, Posterior
from palpate.inversion.search import Mode, search
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue import CaseError, StrokeError

Floats = NDArray[np.float64]

_MOST, _NEARLY = 4, 30.0
"""So many modes are asked about, within so much of the best one's misfit, a stroke."""
_AS_WELL = 20.0
"""Within so much of the best one's promise they go on."""
_ROUNDS, _STAYS = 6, 50.0
"""Guesses of one mode, at most: until it promises so little of the misfit, which is kept."""
_RIPPLE = 5.0
"""Of two guesses the contact's nodes may make the better one worse by so much."""
_STEPS, _ENOUGH, _DAMPING = 20, 0.1, 1e-3
_UNSURE = 1.5
"""So many times what frames are off counts as wrong of all pressures: it is under the lump that they are."""


def set_right(noise: Noise, modes: Sequence[Found], assemble: Assemble, known: float = np.inf) -> list[Found]:
    """The modes as the solver has them, but for those that it does not explain or cannot compute.

    What it says of one mode is known to all of them.

    known : float
        Another class's misfit; modes that stay far over it are not followed.
    """
    strokes, parts = len(modes[0].kept), []
    for part in modes[0].posterior.parts:
        parts.append(Posterior(modes[0].posterior.of, part.stroke, noise, FINE_MESH))
        parts[-1].mean[:] = part.mean
    posterior, forward = assemble(parts, None)
    assert isinstance(forward, Emulates)
    going: list[_Followed] = []
    for mode in _unlike(modes, _NEARLY * strokes):
        one = _Followed(posterior, forward, mode)
        if one.on():
            going.append(one)
            if one.promised > known + _NEARLY * strokes:
                break
    while going:
        best = min(one.promised for one in going)
        near = [one for one in going if one.promised < best + _AS_WELL * strokes]
        going = distinct(near, lambda one: one.promised)  # some come together on their way
        moving = [one for one in going if one.goes_on]
        if not moving or best > known + _NEARLY * strokes:
            break
        min(moving, key=lambda one: one.promised).on()
    return [one.told() for one in going]


def _unlike(modes: Sequence[Found], nearly: float) -> list[Found]:
    """The best mode and some within `nearly` of its misfit, those least like one another; the best first."""
    best, *others = sorted(modes, key=lambda one: one.mode.misfit.total)
    most = best.mode.misfit.total + nearly
    others = [one for one in others if one.mode.misfit.total < most]
    at, sd = best.posterior.at["tissue"], best.posterior.of.column("sd")
    kept = [best]
    while others and len(kept) < _MOST:
        apart = [
            min(float(np.linalg.norm((one.mode.z[at] - other.mode.z[at]) / sd)) for other in kept)
            for one in others
        ]
        kept.append(others.pop(int(np.argmax(apart))))
    return sorted(kept, key=lambda one: one.mode.misfit.total)


class _Followed:
    """One mode on its way.

    Attributes
    ----------
    posterior : Together
    mode : Mode
        Where it goes next.
    promised : float
        The misfit there; where it may go no further, the one it has come to.
    """

    def __init__(self, posterior: Together, forward: Emulates, found: Found) -> None:
        self.posterior, self._forward, self._kept = posterior, forward, found.kept
        self.mode, self.promised = found.mode, np.inf
        self._next = self._best = found.mode.z
        self._least, self._stays, self._done = np.inf, False, 0

    @property
    def goes_on(self) -> bool:
        """Whether there is more to be asked."""
        return self._done < _ROUNDS and not self._stays

    def _searched(self, z: Floats) -> Mode:
        return search(self.posterior, self._forward, z, _STEPS, enough=_ENOUGH, damping=_DAMPING)

    def on(self) -> bool:
        """Ask the solver about the next guess, and search on; whether it has computed any."""
        posterior, forward, z = self.posterior, self._forward, self._next
        tissue = z[posterior.at["tissue"]]
        self._done += 1
        try:
            forward.set_right(tissue, posterior.places(z), posterior.forces(z))
        except (CaseError, StrokeError):
            self._next = (self._best + z) / 2
        else:
            wrong = max(FINE_MESH.of_pressure, _UNSURE * forward.unsure)
            for part in posterior.parts:
                part.weigh(FINE_MESH._replace(of_pressure=wrong))
            there = posterior.misfit(z, forward(tissue, posterior.places(z), posterior.forces(z))).total
            if there < self._least + _RIPPLE:
                self._best, self._least = z, min(there, self._least)
            self.mode = self._searched(self._best)
            self._next, self.promised = self.mode.z, self.mode.misfit.total
            self._stays = self._least - self.promised < _STAYS
        if self._done == _ROUNDS and not self._stays:
            self.promised = self._least
        return bool(np.isfinite(self._least))

    def told(self) -> Found:
        """Where it has come to."""
        mode = self.mode
        if not self._stays:  # what the last search promises has not been computed
            mode = replace(search(self.posterior, self._forward, self._best, 0), settled=False)
        return Found(self.posterior, self._forward, mode, self._kept)
