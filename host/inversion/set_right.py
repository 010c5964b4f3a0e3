"""Modes of the emulator, followed with what the solver says otherwise there, until it has no more to say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.forward import FINE, Emulates
from palpate.inversion.found import Assemble, Found, distinct
from palpate.inversion.posterior import Posterior
from palpate.inversion.search import Mode, search
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue import CaseError, StrokeError

Floats = NDArray[np.float64]

_FIRST, _MOST = 6, 4
"""So many modes are looked at; so many of them, at most, go on."""
_NEARLY, _AS_WELL = 30.0, 20.0
"""Within so much of the best one's misfit, a stroke, by the emulator alone, and once set right."""
_ROUNDS, _STAYS = 6, 4.0
"""Guesses of one mode, at most: until it promises so little of the misfit. A tenth of that is not kept."""
_RIPPLE = 5.0
"""Of two guesses the contact's nodes may make the better one worse by so much."""
_SHORTER = 0.1, 0.5
"""So much of a step that led up is tried next, as a parabola says."""
_STEPS, _ENOUGH, _DAMPING = 20, 0.1, 1e-3


def set_right(noise: Noise, modes: Sequence[Found], assemble: Assemble, known: float = np.inf) -> list[Found]:
    """The modes as the solver has them, but for those that it does not explain or cannot compute.

    known : float
        Another class's misfit; modes that stay far over it are not followed.
    """
    begun = [_Followed(noise, mode, assemble) for mode in modes[:_FIRST]]
    going = distinct(begun, lambda one: one.promised)[:_MOST]
    ahead = None
    while True:
        right = min((one.promised for one in going if one.right), default=np.inf)
        if known < right - _NEARLY * len(modes[0].kept) < np.inf:
            return [one.told() for one in going if one.right]
        alone = min((one.alone for one in going), default=np.inf)
        near = [one for one in going if one.over(right, alone) < one.within]
        going = distinct(near, lambda one: one.promised)  # some come together on their way
        moving = [one for one in going if one.goes_on]
        if not moving:
            return [one.told() for one in going]
        first = min(moving, key=lambda one: one.promised)
        if not first.on(ahead):
            going.remove(first)
        ahead = ahead or first


class _Followed:
    """One mode on its way.

    Attributes
    ----------
    posterior : Together
    mode : Mode
        Where it goes next.
    promised : float
        The misfit there; where it may go no further, the one it has come to.
    alone : float
        The misfit by the emulator alone, which allows for what that gets wrong.
    right : bool
        Whether the solver has been asked.
    goes_on : bool
    """

    def __init__(self, noise: Noise, found: Found, assemble: Assemble) -> None:
        parts = []
        for part in found.posterior.parts:
            parts.append(Posterior(found.posterior.of, part.stroke, noise, FINE.hx_mm))
            parts[-1].mean[:] = part.mean
        self.found, self.goes_on, self.right = found, True, False
        self.posterior, forward = assemble(parts, None)
        assert isinstance(forward, Emulates)
        self._forward = forward
        self.mode = self._searched(found.mode.z)
        self._next = self._best = self.mode.z
        self.promised, self.alone = self.mode.misfit.total, found.mode.misfit.total
        self._least, self._stays, self._done = np.inf, False, 0

    def _searched(self, z: Floats) -> Mode:
        return search(self.posterior, self._forward, z, _STEPS, enough=_ENOUGH, damping=_DAMPING)

    def on(self, like: _Followed | None = None) -> bool:
        """Ask the solver about the next guess, and search on; whether that could be done at all.

        like : _Followed, optional
            Another mode over the same strokes: what the tissue's ends change it has from there.
        """
        could = self._ask(like)
        if self._done == _ROUNDS and not self._stays:
            self.promised = self._least
        return could

    def _ask(self, like: _Followed | None) -> bool:
        posterior, forward, z = self.posterior, self._forward, self._next
        tissue = z[posterior.at["tissue"]]
        self._done += 1
        self.goes_on = self._done < _ROUNDS
        if like is not None:
            forward.like(like._forward)
        try:
            forward.set_right(tissue, posterior.places(z), posterior.forces(z))
        except (CaseError, StrokeError):
            self._next = (self._best + z) / 2
            return self.right
        there = posterior.misfit(z, forward(tissue, posterior.places(z), posterior.forces(z))).total
        self.right = True
        if there < self._least + _RIPPLE:
            self._best, self._least = z, min(there, self._least)
        else:
            forward.go_back()
            promised, worse = self._least - self.promised, there - self._least
            share = np.clip(promised / (worse + 2 * promised), *_SHORTER)
            self._next = self._best + share * (z - self._best)
            return True
        self.mode = self._searched(self._best)
        self._next, self.promised = self.mode.z, self.mode.misfit.total
        self._stays = self._least - self.promised < _STAYS
        self.goes_on &= not self._stays
        return True

    def over(self, right: float, alone: float) -> float:
        """How far its promise is over the best one of those set right, or by the emulator alone."""
        return self.promised - right if self.right else self.alone - alone

    @property
    def within(self) -> float:
        """So far over the best promise it may be the best one."""
        return (_AS_WELL if self.right else _NEARLY) * len(self.found.kept)

    def told(self) -> Found:
        """Where it has come to."""
        mode = self.mode
        if not self._stays:  # what the last search promises has not been computed
            mode = replace(search(self.posterior, self._forward, self._best, 0), settled=False)
        return Found(self.posterior, self._forward, mode, self.found.kept)
