"""Two lumps of one stiffness, one behind the other along the stroke: the class, its forward model, its modes.

What each changes of pressure and displacement over plain tissue is added up, as `sim.probe.two_lumps` does:
lumps nearer than their diameter feel each other, which is left out. Units: mm, kPa, N/m.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.classes import APART, DEEPER, LARGER, Class, Unknown
from palpate.inversion.departures import TWO_LUMPS
from palpate.inversion.emulated import AFAR_MM, EmulatedForward
from palpate.inversion.forward import Emulated, SaysSlopes, Slopes
from palpate.inversion.found import Found, distinct
from palpate.inversion.joint import Together
from palpate.inversion.modes import EMULATED_ENOUGH, EMULATED_STEPS
from palpate.inversion.posterior import EMULATED, Posterior
from palpate.inversion.search import search
from palpate.inversion.set_right import set_right
from palpate.inversion.under import emulated_of
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue import CaseError, Settings, StrokeError

Floats = NDArray[np.float64]

_MORE = (
    Unknown(LARGER, 0.0, 0.35, -1.2, 1.2, 0.2),
    Unknown(DEEPER, 0.0, 0.2, -0.8, 0.8, 0.15),
    Unknown(APART, 14.0, 7.0, 5.0, 45.0, 2.5),
)
_STARTS = (8.0, -0.5, 0.75), (13.0, -0.5, 0.85), (18.0, 0.0, 0.95), (18.0, -1.0, 0.95)
"""How far apart; how much of that the first lies from where one lump would; their diameter over its."""
_BEGUN, _FOLLOWED = 3, 3
"""From so many modes of one lump it begins; so many of two are set right."""


def two_of(one: Class) -> Class:
    """The class of two such lumps as `one` has; its case is the first's."""
    k = len(one.unknowns)
    return replace(
        one, name=TWO_LUMPS, unknowns=(*one.unknowns, *_MORE), case=lambda theta: one.case(theta[:k])
    )


class AsTwo(NamedTuple):
    """What two lumps make of strokes.

    Attributes
    ----------
    modes : list of Found
        Set right, the best first; none where the emulator has them explain no more than one.
    over_one : float or None
        How likely two are over one, as a logarithm; None where neither emulator nor solver can tell.
    """

    modes: list[Found]
    over_one: float | None


def as_two(noise: Noise, modes: Sequence[Found], right: Found) -> AsTwo:
    """Look for two lumps, and set their modes right where the emulator has them explain more than one.

    Parameters
    ----------
    modes : sequence of Found
        The emulator's of one lump, the best first.
    right : Found
        One lump's, set right.
    """
    one = modes[0]
    of = two_of(one.posterior.of)

    def assemble(parts: Sequence[Posterior], settings: Settings | None) -> tuple[Together, TwoForward]:
        # what the solver has said of one lump holds for each of two
        assert isinstance(right.forward, EmulatedForward)
        return Together(parts), TwoForward(of, right.forward)

    parts = [Posterior(of, part.stroke, noise, EMULATED) for part in one.posterior.parts]
    posterior = Together(parts)
    forward = TwoForward(of, emulated_of(one.posterior.of, [part.stroke for part in parts]))
    found = []
    for start in (start for mode in modes[:_BEGUN] for start in _starts(mode, parts)):
        try:
            mode = search(
                posterior, forward, posterior.joined(start), EMULATED_STEPS, enough=EMULATED_ENOUGH, least=1.0
            )
        except (CaseError, StrokeError):
            continue
        found.append(Found(posterior, forward, mode, one.kept))
    better = [it for it in found if it.mode.misfit.total < one.mode.misfit.total]
    if not better:
        over = max((it.mode.log_evidence - one.mode.log_evidence for it in found), default=None)
        return AsTwo([], over)
    likely = distinct(better, lambda it: it.mode.misfit.total)[:_FOLLOWED]
    two = set_right(noise, likely, assemble, right.mode.misfit.total)
    two.sort(key=lambda it: -it.mode.log_evidence)
    return AsTwo(two, two[0].mode.log_evidence - right.mode.log_evidence if two else None)


def _starts(one: Found, parts: Sequence[Posterior]) -> Iterator[list[Floats]]:
    """Each stroke's own numbers where a search for two lumps begins."""
    z, before = one.mode.z, one.posterior
    for apart, share, size in _STARTS:
        theta = np.concatenate([z[before.at["tissue"]], [0.0, 0.0, apart]])
        theta[0] += np.log(size)
        begun = []
        for alone, part, index in zip(before.parts, parts, before.index):
            own = z[index]
            E_kPa, lump_mm = float(np.exp(alone.one(own, "ln_E"))), alone.one(own, "start")
            begun.append(part.start(theta, E_kPa, lump_mm + share * apart))
        yield begun


class TwoForward(SaysSlopes):
    """Emulates frames over two lumps, set right over each of them alone.

    Parameters
    ----------
    of : Class
        Of both.
    alone : EmulatedForward
        Over one of them.
    """

    def __init__(self, of: Class, alone: EmulatedForward) -> None:
        self.of, self._alone = of, alone
        self.scale = of.scale
        names = [unknown.name for unknown in of.unknowns]
        self._own, self._apart = np.eye(len(alone.of.unknowns), len(names)), names.index(APART)
        self._others = self._own.copy()
        self._others[names.index("ln d"), names.index(LARGER)] = 1.0
        self._others[names.index("ln depth"), names.index(DEEPER)] = 1.0

    def __call__(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> Emulated:
        """Frames (n,) of a guess, places from the first lump.

        Raises
        ------
        CaseError
            There is no such tissue.
        """
        own = self._own @ theta
        first = self._alone(own, places_mm, forces_N_per_m)
        other = self._alone(self._others @ theta, places_mm - theta[self._apart], forces_N_per_m)
        plain = self._alone(own, np.full(len(places_mm), AFAR_MM), forces_N_per_m)
        steep = [
            self._sum(*(getattr(frames.slopes, name) for frames in (first, other, plain)))
            for name in ("images", "depth")
        ]
        return Emulated(
            theta, places_mm, forces_N_per_m, first.images + other.images - plain.images,
            first.depth + other.depth - plain.depth, Slopes(*steep),
        )  # fmt: skip

    def _sum(self, first: Floats, other: Floats, plain: Floats) -> Floats:
        """Derivatives by this class's unknowns, the place and ln F, of each lump's and plain tissue's."""
        of_tissue = (first - plain)[..., :-2] @ self._own + other[..., :-2] @ self._others
        of_tissue[..., self._apart] -= other[..., -2]
        place, force = first[..., -2] + other[..., -2], (first + other - plain)[..., -1]
        return np.concatenate([of_tissue, place[..., None], force[..., None]], -1)

    @property
    def unsure(self) -> float:
        """As one lump's."""
        return self._alone.unsure

    def away(self, theta: Floats) -> float:
        """Of the lump whose like is farther."""
        return max(self._alone.away(of_one @ theta) for of_one in (self._own, self._others))

    def set_right(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> None:
        """As `EmulatedForward.set_right`, over each lump alone."""
        self._alone.set_right(self._own @ theta, places_mm, forces_N_per_m)
        self._alone.set_right(self._others @ theta, places_mm - theta[self._apart], forces_N_per_m)
