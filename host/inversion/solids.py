"""Inverting a stroke over a solid lump: a search on the emulator, set right by the solver where it ends.

Space mapping (Bandler and others 1994): the solver computes one stroke at the emulator's mode; what it says
otherwise is added to the emulator, and the search goes on from there, until the mode stays. Balls and
ellipsoids are compared by their evidence.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.answer.fitted import Inverted
from palpate.inversion.classes import Class
from palpate.inversion.felt import FeltStroke
from palpate.inversion.mirror import mirrored_about
from palpate.inversion.pooled import pooled
from palpate.inversion.result import of_modes, told
from palpate.inversion.search import Mode, search
from palpate.inversion.solid_classes import BALL, ELLIPSOID, OFFSET, RATIO, SOLIDS, learnt
from palpate.inversion.solid_forward import Correction, SolidForward, bundled, correction_at
from palpate.inversion.solid_posterior import SolidPosterior, binned
from palpate.inversion.start import MIDDLE, Start
from palpate.inversion.widening import WIDER_SOLID
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue import Case, CaseError, StrokeError
from palpate.sim.tissue.case import FORCE_UNIT_N_PER_M
from palpate.wire.cells import COLUMN_MM

Floats = NDArray[np.float64]

_NEAR_MM = 17.0
"""Farther from the lump every third frame will do, and of the press."""
_THIN = 3
_RATIO = 6
"""Of the emulator's inputs, the gland's stiffness over the fat's."""
_STEPS, _ENOUGH = 20, 1.0
_HOPELESS = 150.0
"""A start whose misfit is so much over the best one's after some steps is not followed."""
_SOFT, _HARD = 0.45, 0.1
_SIZED, _LESS, _MORE = 1.3, -0.5, 0.4
"""Sizes of further first guesses, and ln of their glands' stiffness over the usual."""
_ROUNDS = 3
_STAYS = 0.5
"""The mode stays where no number of the lump moves by so much of its standard deviation."""
_LUMP = ("ln d", "ln depth", "E^-2/3")
_RARE = 0.01
_AS_WELL, _SAME = 10.0, 0.5
"""An interval holds those of every mode of a class with greater odds whose misfit is within so much of its
best one's: the valley is long, and curved. Modes nearer than so many standard deviations are one."""
_BESIDE_MM, _MATTERS = (0.0, 2.0, 4.0, 6.0, 8.0), 100.0
"""The emulator has met few lumps beside the line, so a search stays about where it begins there: the first of
these whose misfit is not larger than another's by more than the emulator may be wrong."""
_ON_LINE_MM = 2.5
"""A bump whose middle is so near that of the face is looked for on the line."""


@dataclass(frozen=True)
class Found:
    """A class's best mode by one forward model."""

    posterior: SolidPosterior
    mode: Mode

    @property
    def of(self) -> Class:
        """The class."""
        return self.posterior.of

    def theta(self, of: Class) -> Floats:
        """Its mode as a guess for another class; what that lacks is left out."""
        known = dict(zip((unknown.name for unknown in self.of.unknowns), self.mode.z))
        return np.array([known.get(unknown.name, unknown.mean) for unknown in of.unknowns])


def invert_solid(stroke: FeltStroke, start: Start, noise: Noise) -> Inverted:
    """Invert one stroke over a lump that ends across it; as `palpate.inversion.strokes.invert_stroke`."""
    place = mirrored_about(stroke)
    if place is not None:
        start = replace(start, lump_mm=place)
    some = binned(_thinned(stroke, start.lump_mm))
    emulator, errors = bundled()
    ratios = emulator.learnt(_RATIO)
    classes = [learnt(of, ratios, len(errors.image)) for of in (ELLIPSOID, BALL)]
    modes = _first(classes, some, start, noise)
    if not modes:
        return Inverted(stroke.stroke, problem=f"stroke {stroke.stroke}: no solid lump could be computed")
    rounds, stays = 0, False
    while rounds < _ROUNDS and not stays:
        before = _best(modes)
        try:
            correction = correction_at(_case(before), emulator)
        except (CaseError, StrokeError):
            break
        rounds += 1
        modes = _again(modes, some, noise, correction) or modes
        stays = _moved(before, _best(modes)) < _STAYS
    modes = [replace(one, mode=replace(one.mode, settled=one.mode.settled and stays)) for one in modes]
    weighed = [replace(one, mode=pooled(one.posterior, one.mode, start)) for one in modes]
    odds = _odds(weighed)
    order = np.argsort([-one.mode.log_evidence for one in weighed], kind="stable")
    near = [weighed[k] for k in order if k == order[0] or odds[weighed[k].of.name] > _RARE]
    said = of_modes(
        [told(p := one.posterior, one.mode, odds, p.places(one.mode.z), WIDER_SOLID) for one in near],
        [one.mode.log_evidence for one in near],
    )
    best = modes[order[0]]
    laid = best.posterior.laid(best.mode.z, best.mode.found)  # type: ignore[arg-type]
    return replace(said, laid=(laid,))


def _first(classes: list[Class], stroke: FeltStroke, start: Start, noise: Noise) -> list[Found]:
    """The modes by the emulator alone, from several starts; the later classes begin at the first's."""
    modes: list[Found] = []
    for of in classes:
        if modes:
            of_class = _from(of, [one.theta(of) for one in modes], stroke, start, noise)
        else:
            of_class = _beside(of, stroke, start, noise)
        modes += _near(of_class)
    return modes


def _beside(of: Class, stroke: FeltStroke, start: Start, noise: Noise) -> list[Found]:
    """A class's modes, searched from beside the line as the columns say or, where it matters, elsewhere."""
    said = _across(stroke, start.lump_mm)
    side = 1.0 if said >= 0 else -1.0
    one_each = [
        (offset, found)
        for offset in dict.fromkeys((said, *(side * y for y in _BESIDE_MM)))
        for found in _from(of, [next(_starts(of, start, offset))], stroke, start, noise)
    ]
    least = min((found.mode.misfit.total for _, found in one_each), default=np.inf)
    for offset, found in one_each:
        if found.mode.misfit.total <= least + _MATTERS:
            _, *others = _starts(of, start, offset)
            return _from(of, others, stroke, start, noise, [found])
    return []


def _from(
    of: Class,
    thetas: list[Floats],
    stroke: FeltStroke,
    start: Start,
    noise: Noise,
    known: Sequence[Found] = (),
) -> list[Found]:
    """A class's modes by the emulator alone, those known and others that guesses lead to."""
    modes, forward = list(known), SolidForward(of, stroke.press)
    for theta in thetas:
        posterior = SolidPosterior(of, stroke, noise)
        least = min((one.mode.misfit.total for one in modes), default=np.inf)
        z = posterior.start(theta, start.E_kPa, start.lump_mm)
        _take(modes, _searched(posterior, forward, z, least + _HOPELESS))
    return modes


def _again(modes: list[Found], stroke: FeltStroke, noise: Noise, correction: Correction) -> list[Found]:
    """The modes by the emulator set right, from where they were."""
    out: list[Found] = []
    for name in SOLIDS:
        of_class: list[Found] = []
        for one in (one for one in modes if one.of.name == name):
            posterior = SolidPosterior(one.of, stroke, noise)
            posterior.mean[:] = one.posterior.mean
            z = one.mode.z.copy()
            z[len(SOLIDS[name].unknowns) : len(one.of.unknowns)] = 0.0
            _take(of_class, _searched(posterior, SolidForward(one.of, stroke.press, correction), z))
        out += _near(of_class)
    return out


def _take(modes: list[Found], found: Found | None) -> None:
    """Add a mode that is not there yet."""
    if found is not None and all(_moved(other, found) > _SAME for other in modes):
        modes.append(found)


def _near(modes: list[Found]) -> list[Found]:
    """Those that explain the stroke about as well as the best."""
    least = min((one.mode.misfit.total for one in modes), default=0.0)
    return [one for one in modes if one.mode.misfit.total <= least + _AS_WELL]


def _searched(
    posterior: SolidPosterior, forward: SolidForward, z: Floats, hopeless: float = np.inf
) -> Found | None:
    try:
        mode = search(posterior, forward, z, _STEPS, enough=_ENOUGH, hopeless=hopeless)
    except (CaseError, StrokeError):
        return None
    return Found(posterior, mode)


def _starts(of: Class, start: Start, offset_mm: float) -> Iterator[Floats]:
    """First guesses: the estimate, softer, harder, smaller and larger over other glands; the middle."""
    valley = [start.as_stiff(s) for s in (start.E_inv23, _SOFT, _HARD)]
    names = [unknown.name for unknown in of.unknowns]
    sized = [
        (replace(start, d_mm=start.d_mm * by, depth_mm=start.depth_mm * by), ratio)
        for by, ratio in ((1 / _SIZED, _LESS), (_SIZED, _MORE))
    ]
    for one, ratio in (*((one, 0.0) for one in valley), *sized, (MIDDLE, 0.0)):
        theta = of.column("mean")
        theta[:3] = np.log(one.d_mm), np.log(one.depth_mm), one.E_inv23
        theta[names.index(OFFSET)] = offset_mm
        theta[names.index(RATIO)] += ratio
        yield theta


def _across(stroke: FeltStroke, lump_mm: float) -> float:
    """Where across the face more is felt over the lump than elsewhere, mm; 0 near its middle."""
    p = stroke.press
    assert stroke.image_kPa is not None
    columns = np.nanmean(stroke.image_kPa[p:], axis=1)
    columns = columns / np.nanmean(columns, axis=1, keepdims=True)
    near = np.abs(stroke.place_mm[p:] - lump_mm) < _NEAR_MM / 2
    if not near.any() or near.all():
        return 0.0
    more = np.maximum(np.nan_to_num(columns[near].mean(0) - columns[~near].mean(0)), 0.0) ** 2
    middle = float(more @ COLUMN_MM / max(more.sum(), 1e-12))
    return middle if abs(middle) > _ON_LINE_MM else 0.0


def _thinned(stroke: FeltStroke, lump_mm: float) -> FeltStroke:
    """Every frame near the lump, some of the others."""
    p, n = stroke.press, len(stroke.place_mm) - stroke.press
    number = np.arange(n)
    chosen = np.flatnonzero((np.abs(stroke.place_mm[p:] - lump_mm) < _NEAR_MM) | (number % _THIN == 0))
    return stroke.take(np.arange(_THIN - 1, p, _THIN), chosen)


def _case(found: Found) -> Case:
    """The lump of a mode, under the mean force of its stroke, in fat of 10 kPa."""
    z, posterior = found.mode.z, found.posterior
    case = found.of.case(z[: len(found.of.unknowns)])
    force = float(np.exp(np.log(posterior.forces(z)[posterior.stroke.press :]).mean()))
    return replace(case, F_rel=force / FORCE_UNIT_N_PER_M)


def _best(modes: list[Found]) -> Found:
    return max(modes, key=lambda found: found.mode.log_evidence)


def _odds(modes: list[Found]) -> dict[str, float]:
    """Of the classes, by their best modes, all as likely beforehand."""
    evidence = {
        name: max(one.mode.log_evidence for one in modes if one.of.name == name)
        for name in SOLIDS
        if any(one.of.name == name for one in modes)
    }
    share = {name: float(np.exp(value - max(evidence.values()))) for name, value in evidence.items()}
    return {name: share[name] / sum(share.values()) for name in share}


def _moved(before: Found, now: Found) -> float:
    """How far the lump's own numbers went, in standard deviations."""
    names = [unknown.name for unknown in now.of.unknowns]
    k = [names.index(name) for name in _LUMP]
    sd = np.sqrt(np.diag(now.mode.covariance)[k])
    return float((np.abs(now.mode.z[k] - before.theta(now.of)[k]) / sd).max())
