"""Two visits to one lump, inverted together: tissue, face, the probe's gains and the lump's stiffness are
common unknowns; how the lump's diameter and depth have changed are unknowns of their own.

What both visits get wrong alike (mesh, tissue, gains) drops out of the change. Units: mm, kPa, N/m.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.answer.fitted import Change, Inverted, Value
from palpate.errors import PalpateError
from palpate.inversion.changing import CHANGE, LATER, added, changing
from palpate.inversion.classes import ANYWHERE, Class
from palpate.inversion.emulated import EmulatedForward
from palpate.inversion.felt import FeltStroke
from palpate.inversion.forward import Forward, Predicted, Predicts, Slopes
from palpate.inversion.found import Ends
from palpate.inversion.joint import Together
from palpate.inversion.kept import Felt
from palpate.inversion.modes import coarse, finest
from palpate.inversion.posterior import Posterior
from palpate.inversion.result import of_modes, told
from palpate.inversion.solid_classes import BALL, ELLIPSOID, moved
from palpate.inversion.solid_modes import Searches
from palpate.inversion.start import agreed
from palpate.inversion.under import classes_over, emulated_of, forward_of, odds_of
from palpate.inversion.widening import WIDER, WIDER_SOLID, Widening
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue import Settings
from palpate.sim.tissue.one_thread import one_blas_thread

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_WIDER_CHANGES = {"ln d": Widening(1.85, 1.85, 0.02), "ln depth": Widening(1.6, 1.6, 0.04)}
"""Of a solid lump; emulator and mesh err otherwise at each visit: chosen on two pairs of visits."""
_RATIOS = {"d_mm": "ln d", "depth_mm": "ln depth"}
"""Those changes' names, and what widens them."""
_OF_THE_PROBE = ("gain", "scale", "creep")
"""Shared besides where both visits were made with one probe; its zeros may have drifted in between."""


@one_blas_thread()
def invert_visits(
    before: Sequence[Felt],
    after: Sequence[Felt],
    noise: Noise,
    same_probe: bool = True,
    kind: str = ANYWHERE.name,
) -> Change:
    """Invert the strokes of two visits to one lump.

    Parameters
    ----------
    before, after : sequences of (FeltStroke, Start)
    same_probe : bool
        Whether gains, the encoder's scale and creep are the same.
    kind : str
        A class with a lump.

    Raises
    ------
    PalpateError
        A visit has no stroke, or the lump could not be computed.
    """
    if not before or not after:
        raise PalpateError("each visit needs a stroke that can be refined")
    strokes = [*before, *after]
    shared = _OF_THE_PROBE if same_probe else ()
    if any(stroke.solid for stroke, _ in strokes):
        return _solid_visits(before, after, noise, shared)
    (single,) = classes_over(strokes[0][0], kind)
    of = changing(single)

    def assemble(parts: Sequence[Posterior], settings: Settings | None) -> tuple[Together, Predicts]:
        strokes = [part.stroke for part in parts]
        forward = TwoVisits(of, single, settings, strokes[: len(before)], strokes[len(before) :])
        return Together(parts, shared), forward

    modes = coarse(of, strokes, noise, {}, assemble)
    if not modes:
        raise PalpateError("no lump could be computed that both visits are over")
    modes = finest(strokes, noise, modes, assemble)
    return _changed(modes, len(before), {of.name: 1.0}, WIDER, WIDER)


def _solid_visits(
    before: Sequence[Felt], after: Sequence[Felt], noise: Noise, shared: tuple[str, ...]
) -> Change:
    """As `invert_visits`, to a lump that ends across the stroke."""
    strokes = [*before, *after]
    start = agreed([own for stroke, own in strokes if stroke.solid])
    searches = Searches(strokes, start, noise, len(before), shared)
    modes = searches.lumps([changing(of) for of in (ELLIPSOID, BALL)])
    if not modes:
        raise PalpateError("no lump could be computed that both visits are over")
    modes = sorted(modes, key=lambda one: -one.mode.log_evidence)
    odds = odds_of((one.of.name, one.mode.log_evidence) for one in modes)
    return _changed(modes, len(before), odds, WIDER_SOLID, _WIDER_CHANGES)


def _changed(
    modes: Sequence[Ends],
    first: int,
    odds: dict[str, float],
    wider: Mapping[str, Widening],
    changes: Mapping[str, Widening],
) -> Change:
    """What modes over two visits say, the first of them of so many strokes."""
    best = modes[0]
    evidence = [one.mode.log_evidence for one in modes]
    before, after = (
        of_modes([_visit(one, part, odds, wider) for one in modes], evidence) for part in (0, first)
    )
    laid = best.posterior.laid(best.mode.z, best.mode.found)
    return Change(
        replace(before, laid=laid[:first], together=first),
        replace(after, laid=laid[first:], together=len(laid) - first),
        {name: _ratio(modes, like, changes[like]) for name, like in _RATIOS.items()},
        before.fits,
    )


@dataclass
class PredictedVisits(Predicted):
    """Frames of both visits, the first `len(each[0].depth)` of them the first one's."""

    each: tuple[Predicted, Predicted]

    def on_mesh_of(self, other: Predicted) -> bool:
        """Whether each visit is on the topology that it was on."""
        assert isinstance(other, PredictedVisits)
        return all(mine.on_mesh_of(its) for mine, its in zip(self.each, other.each))

    @property
    def own(self) -> Floats:
        """As `Predicted.own`: the first visit's frames know of no change."""
        out = super().own
        k = len(self.theta)
        out[: len(self.each[0].places_mm), k - len(LATER) : k] = 0.0
        return out


class TwoVisits:
    """Predicts the frames of two visits, each over its own lump."""

    def __init__(
        self,
        of: Class,
        single: Class,
        settings: Settings | None,
        before: Sequence[FeltStroke],
        after: Sequence[FeltStroke],
    ) -> None:
        self.scale, self._own = of.scale, len(single.unknowns)
        self._later = added(of, LATER)
        self._first = sum(len(stroke.place_mm) for stroke in before)
        self._each = tuple(
            emulated_of(single, strokes) if settings is None else forward_of(single, settings, strokes)
            for strokes in (before, after)
        )

    def __call__(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> PredictedVisits:
        """Frames (n,) of a guess; as `Forward`."""
        n, (one, other) = self._first, self._each
        thetas = self._thetas(theta)
        before = one(thetas[0], places_mm[:n], forces_N_per_m[:n])
        if isinstance(one, Forward) and isinstance(other, Forward):
            other.like(one)
        after = other(thetas[1], places_mm[n:], forces_N_per_m[n:])
        images, depth = (
            np.concatenate([getattr(visit, name) for visit in (before, after)])
            for name in ("images", "depth")
        )
        return PredictedVisits(
            theta.copy(), places_mm, forces_N_per_m, images, depth, (before, after)
        )  # fmt: skip

    def _thetas(self, theta: Floats) -> tuple[Floats, Floats]:
        """Each visit's unknowns of the single class."""
        return theta[: self._own], (self._later @ theta)[: self._own]

    def slopes(self, at: PredictedVisits) -> Slopes:
        """Derivatives at a guess."""
        found = [one.slopes(visit) for one, visit in zip(self._each, at.each)]  # type: ignore[arg-type]
        k = found[0].depth.shape[1] - 2
        return Slopes(
            np.concatenate([_with_change(one.images, k, later) for later, one in enumerate(found)]),
            np.concatenate([_with_change(one.depth, k, later) for later, one in enumerate(found)]),
        )

    @property
    def unsure(self) -> float:
        """As the visit's that is told less well."""
        return max(one.unsure for one in self._each if isinstance(one, EmulatedForward))

    def away(self, theta: Floats) -> float:
        """Of the visit whose like is farther."""
        each = zip(self._each, self._thetas(theta))
        return max(one.away(its) for one, its in each if isinstance(one, EmulatedForward))

    def set_right(self, theta: Floats, places_mm: Floats, forces_N_per_m: Floats) -> None:
        """Let the solver compute both visits of a guess."""
        n = self._first
        for one, its, frames in zip(self._each, self._thetas(theta), (slice(0, n), slice(n, None))):
            assert isinstance(one, EmulatedForward)
            one.set_right(its, places_mm[frames], forces_N_per_m[frames])


def _with_change(slopes: Floats, k: int, later: int) -> Floats:
    """With columns for the changes behind the k of tissue and lump: those of the first few, or nothing."""
    change = slopes[..., : len(LATER)] * later
    return np.concatenate([slopes[..., :k], change, slopes[..., k:]], axis=-1)


def _visit(found: Ends, part: int, odds: dict[str, float], wider: Mapping[str, Widening]) -> Inverted:
    """What one visit's lump is, by one of its strokes; the first one's is part 0."""
    posterior, z = found.posterior, found.mode.z
    own = np.eye(len(z))[posterior.index[part]]
    if part:
        T, at = np.eye(len(own)), posterior.at["tissue"]
        T[at, at] = added(posterior.of, [*LATER, moved(part)])
        own = T @ own
    return told(posterior.parts[part], found.mode.own(own), odds, posterior.places(z), wider)


def _ratio(modes: Sequence[Ends], like: str, wider: Widening) -> Value:
    """Of the second visit's over the first one's, by the first mode; the interval holds every one's."""
    values, halves = [], []
    for one in modes:
        k = [unknown.name for unknown in one.posterior.of.unknowns].index(f"{CHANGE} {like}")
        values.append(one.mode.z[k])
        halves.append(wider.half(float(np.sqrt(one.mode.covariance[k, k])), one.mode.settled))
    low, high = min(np.subtract(values, halves)), max(np.add(values, halves))
    return Value(*(float(np.exp(v)) for v in (values[0], low, high)))
