"""Modes of the emulator, followed with what the solver says otherwise there, until it has no more to say.

A glance tells which of several modes may last. These are near their ends, so that derivatives are set right
once: in directions that a stroke tells little of, small errors of theirs look like knowledge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.inversion.forward import FINE, Asked, Emulates
from palpate.inversion.found import Assemble, Found, distinct
from palpate.inversion.posterior import Posterior
from palpate.inversion.search import Mode, search
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue import CaseError, StrokeError

_FIRST, _MOST = 6, 4
"""So many modes are glanced at; so many of them, at most, go on."""
_NEARLY, _AS_WELL = 40.0, 20.0
"""Within so much of the best one's misfit, a stroke, after a glance, and later."""
_ROUNDS, _STAYS = 6, 2.0
"""Guesses of one mode, at most: until it promises so little of the misfit. Where a promise was not kept to so
much, derivatives are asked for anew."""
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
    begun: list[_Followed] = []
    asks = Asked.SLOPES if len(modes) == 1 and known == np.inf else Asked.GLANCE
    for mode in modes[:_FIRST]:
        follow = _Followed(noise, mode, assemble, asks)
        if follow.on(begun[0] if begun else None):
            begun.append(follow)
    going = distinct(begun, lambda one: one.promised)[:_MOST]
    ahead = going[0] if going else None
    while True:
        least = min((one.promised for one in going), default=np.inf)
        if known < least - _NEARLY * len(modes[0].kept):
            return [one.told() for one in going]
        right = min((one.promised for one in going if one.right), default=np.inf)
        glanced = min((one.glanced for one in going), default=np.inf)
        near = [one for one in going if one.over(right, glanced) < one.within]
        going = distinct(near, lambda one: one.promised)  # some come together on their way
        moving = [one for one in going if one.goes_on]
        if not moving:
            return [one.told() for one in going]
        min(moving, key=lambda one: one.promised).on(ahead)


class _Followed:
    """One mode on its way.

    Attributes
    ----------
    posterior : Together
    promised : float
        The misfit where it goes next; where it may go no further, the one it has come to.
    glanced : float
        The misfit that the glance promised. Its few frames give another misfit than all of them, so it is
        compared with other glances only.
    right : bool
        Whether the solver has been asked for more than a glance.
    goes_on : bool
    """

    def __init__(self, noise: Noise, found: Found, assemble: Assemble, asks: Asked) -> None:
        parts = []
        for part in found.posterior.parts:
            parts.append(Posterior(found.posterior.of, part.stroke, noise, FINE.hx_mm))
            parts[-1].mean[:] = part.mean
        self.found, self.promised, self.goes_on = found, np.inf, True
        self.glanced, self.right = np.inf, False
        self.posterior, forward = assemble(parts, None)
        assert isinstance(forward, Emulates)
        self._forward = forward
        self._next = self._best = found.mode.z
        self._least, self._stays = np.inf, False
        self._asks, self._done = asks, 0
        self._mode: Mode | None = None

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
            forward.set_right(tissue, posterior.places(z), posterior.forces(z), self._asks)
        except (CaseError, StrokeError):
            self._next = (self._best + z) / 2
            return self._mode is not None
        there = posterior.misfit(z, forward(tissue, posterior.places(z), posterior.forces(z))).total
        as_promised = self._least == np.inf or there < self.promised + _STAYS
        if there < self._least + _RIPPLE:
            self._best, self._least = z, min(there, self._least)
        else:
            forward.go_back()
            promised, worse = self._least - self.promised, there - self._least
            share = np.clip(promised / (worse + 2 * promised), *_SHORTER)
            self._next = self._best + share * (z - self._best)
            return True
        self._mode = search(posterior, forward, self._best, _STEPS, enough=_ENOUGH, damping=_DAMPING)
        self._next, self.promised = self._mode.z, self._mode.misfit.total
        if self._asks is Asked.GLANCE:
            self._asks, self._least, self.glanced = Asked.SLOPES, np.inf, self.promised
            return True
        self.right = True
        self._asks = Asked.VALUES if as_promised else Asked.SLOPES
        self._stays = self._least - self.promised < _STAYS
        self.goes_on &= not self._stays
        return True

    def over(self, right: float, glanced: float) -> float:
        """How far its promise is over the best one of those set right, or of glances."""
        return self.promised - right if self.right else self.glanced - glanced

    @property
    def within(self) -> float:
        """So far over the best promise it may be the best one."""
        return (_AS_WELL if self.right else _NEARLY) * len(self.found.kept)

    @property
    def mode(self) -> Mode:
        """Where it goes next, once it has been on."""
        assert self._mode is not None
        return self._mode

    def told(self) -> Found:
        """Where it has come to."""
        mode = self.mode
        if not self._stays:  # what the last search promises has not been computed
            mode = replace(search(self.posterior, self._forward, self._best, 0), settled=False)
        return Found(self.posterior, self._forward, mode, self.found.kept)
