"""Inverting strokes over a solid lump: a search on the emulator, set right by the solver where it ends.

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
from palpate.inversion.joint import Together
from palpate.inversion.kept import Felt
from palpate.inversion.mirror import mirrored_about
from palpate.inversion.pooled import pooled
from palpate.inversion.result import of_modes, told_together
from palpate.inversion.search import Mode, search
from palpate.inversion.solid_classes import BALL, ELLIPSOID, OFFSET, RATIO, SOLIDS, learnt
from palpate.inversion.solid_forward import Correction, OverOneLump, bundled, correction_at
from palpate.inversion.solid_posterior import SolidPosterior, binned
from palpate.inversion.start import MIDDLE, SIZE_BY_STIFFNESS, Start
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
_HOPELESS = 2.0
"""A start whose misfit is over the best one's by this part of it after some steps is not followed."""
_SOFT, _HARD = 0.45, 0.1
_SIZED, _LESS, _MORE = 1.3, -0.5, 0.4
"""Sizes of further first guesses, and ln of their glands' stiffness over the usual."""
_ROUNDS, _OTHERS = 3, 2
_STIFFNESSES = 0.08, 0.25, 0.5
_ELSEWHERE, _WORTH = 2.0, 100.0
"""Another mode is so many standard deviations away, and looked at where its misfit, a stroke, is not worse by
more: the solver has spoken elsewhere."""
_STAYS = 0.5
"""The mode stays where no number of the lump moves by so much of its standard deviation."""
_LUMP = ("ln d", "ln depth", "E^-2/3")
_RARE = 0.01
_AS_WELL, _SAME = 10.0, 0.5
"""An interval holds those of every mode of a class with greater odds whose misfit is within so much of its
best one's: the valley is long, and curved. Modes nearer than so many standard deviations are one."""
_BESIDE_MM = 0.0, 2.0, 4.0, 6.0, 8.0
"""The emulator has met few lumps beside the line, so a search stays about where it begins there."""
_ROUGH = 0.1
"""Before the solver has set the emulator right a misfit says no more than this part of it."""
_ALIKE = 0.15
"""Logarithms of forces so near each other share what the solver says."""
_ON_LINE_MM = 2.5
"""A bump whose middle is so near that of the face is looked for on the line."""


@dataclass(frozen=True)
class Found:
    """A class's best mode by one forward model."""

    posterior: Together
    mode: Mode

    @property
    def of(self) -> Class:
        """The class."""
        return self.posterior.of

    def theta(self, of: Class) -> Floats:
        """Its mode as a guess for another class; what that lacks is left out."""
        known = dict(zip((unknown.name for unknown in self.of.unknowns), self.mode.z))
        return np.array([known.get(unknown.name, unknown.mean) for unknown in of.unknowns])

    @property
    def offset_mm(self) -> float:
        """How far beside the line its lump lies."""
        return float(self.mode.z[[unknown.name for unknown in self.of.unknowns].index(OFFSET)])

    def cases(self) -> list[Case]:
        """The lump under the mean force of each stroke, in fat of 10 kPa."""
        posterior, z = self.posterior, self.mode.z
        case = self.of.case(z[: len(self.of.unknowns)])
        forces = [
            float(np.exp(np.log(part.forces(z[index])[part.stroke.press :]).mean()))
            for part, index in zip(posterior.parts, posterior.index)
        ]
        return [replace(case, F_rel=force / FORCE_UNIT_N_PER_M) for force in forces]


class _Searches:
    """Searches of strokes over one lump.

    Parameters
    ----------
    start : Start
        What is said of the lump.
    lumps_mm : list of float
        Where it lies along each stroke.
    """

    def __init__(self, strokes: Sequence[FeltStroke], start: Start, lumps_mm: list[float], noise: Noise):
        self.strokes, self.start, self.lumps_mm, self.noise = strokes, start, lumps_mm, noise

    def first(self, classes: Sequence[Class]) -> list[Found]:
        """The modes by the emulator alone, from several starts; the later classes begin at the first's."""
        modes: list[Found] = []
        for of in classes:
            guesses = [one.theta(of) for one in modes]
            modes += _near(self._from(of, guesses) if modes else self._beside(of), _ROUGH)
        return modes

    def set_right(self, modes: list[Found], rounds: int) -> tuple[list[Found], list[Correction]]:
        """The modes where the solver lets the best of them stay, and what it has said there."""
        corrections: list[Correction] = []
        stays = False
        while rounds and not stays:
            before = _best(modes)
            try:
                corrections = _corrections(before.cases())
            except (CaseError, StrokeError):
                break
            rounds -= 1
            modes = self.again(modes, corrections) or modes
            stays = _moved(before, _best(modes)) < _STAYS
        settled = [replace(one.mode, settled=one.mode.settled and stays) for one in modes]
        return [replace(one, mode=mode) for one, mode in zip(modes, settled)], corrections

    def elsewhere(self, best: Found, corrections: Sequence[Correction]) -> list[Found]:
        """Other lumps, softer and harder, that feel nearly like the best one; nearest first."""
        if not corrections:
            return []
        names = [unknown.name for unknown in best.of.unknowns]
        size, stiffness = (names.index(name) for name in ("ln d", "E^-2/3"))
        forward = OverOneLump(best.of, self.strokes, corrections)
        others: list[Found] = []
        for s in _STIFFNESSES:
            z = best.mode.z.copy()
            z[size] += SIZE_BY_STIFFNESS * (s - z[stiffness])
            z[stiffness] = s
            found = _searched(best.posterior, forward, z, (1 + _HOPELESS) * best.mode.misfit.total)
            if found is not None and _moved(best, found) > _ELSEWHERE:
                _take(others, found)
        most = best.mode.misfit.total + _WORTH * len(self.strokes)
        return sorted(
            (one for one in others if one.mode.misfit.total < most), key=lambda one: one.mode.misfit.total
        )

    def again(self, modes: Sequence[Found], corrections: Sequence[Correction]) -> list[Found]:
        """The modes by the emulator set right, from where they were."""
        out: list[Found] = []
        for name in SOLIDS:
            of_class: list[Found] = []
            for one in (one for one in modes if one.of.name == name):
                z = one.mode.z.copy()
                z[len(SOLIDS[name].unknowns) : len(one.of.unknowns)] = 0.0
                _take(of_class, _searched(one.posterior, OverOneLump(one.of, self.strokes, corrections), z))
            out += _near(of_class)
        return out

    def _beside(self, of: Class) -> list[Found]:
        """A class's modes, searched from beside the line as the columns say or, where needed, elsewhere."""
        said = float(np.median([_across(one, at) for one, at in zip(self.strokes, self.lumps_mm)]))
        side = 1.0 if said >= 0 else -1.0
        offsets = list(dict.fromkeys((said, *(side * y for y in _BESIDE_MM))))
        one_each = self._from(of, [next(_starts(of, self.start, offset)) for offset in offsets])
        if not one_each:
            return []
        best = min(one_each, key=lambda one: one.mode.misfit.total)
        modes = [_near(one_each, _ROUGH)[0]]
        _take(modes, best)
        _, *others = _starts(of, self.start, modes[0].offset_mm)
        return self._from(of, others, modes)

    def _from(self, of: Class, thetas: Sequence[Floats], known: Sequence[Found] = ()) -> list[Found]:
        """A class's modes by the emulator alone, those known and others that guesses lead to."""
        modes, forward = list(known), OverOneLump(of, self.strokes)
        for theta in thetas:
            posterior = Together([SolidPosterior(of, stroke, self.noise) for stroke in self.strokes])
            least = min((one.mode.misfit.total for one in modes), default=np.inf)
            z = posterior.start(theta, self.start.E_kPa, self.lumps_mm)
            _take(modes, _searched(posterior, forward, z, (1 + _HOPELESS) * least))
        return modes


def invert_solid(strokes: Sequence[Felt], noise: Noise) -> Inverted:
    """Invert strokes over one lump that ends across them; as `palpate.inversion.strokes.invert_together`."""
    some, lumps_mm = [], []
    for stroke, own in strokes:
        place = mirrored_about(stroke)
        lumps_mm.append(own.lump_mm if place is None else place)
        some.append(binned(_thinned(stroke, lumps_mm[-1])))
    start = _agreed([own for stroke, own in strokes if stroke.solid])
    number = strokes[0][0].stroke
    emulator, errors = bundled()
    ratios = emulator.learnt(_RATIO)
    searches = _Searches(some, start, lumps_mm, noise)
    modes = searches.first([learnt(of, ratios, len(errors.image)) for of in (ELLIPSOID, BALL)])
    if not modes:
        return Inverted(number, problem=f"stroke {number}: no solid lump could be computed")
    modes, corrections = searches.set_right(modes, _ROUNDS)
    for other in searches.elsewhere(_best(modes), corrections)[:_OTHERS]:
        modes += searches.set_right([other], _ROUNDS - 1)[0]
    modes = _near(modes)
    weighed = [replace(one, mode=pooled(one.posterior, one.mode, start)) for one in modes]
    odds = _odds(weighed)
    order = np.argsort([-one.mode.log_evidence for one in weighed], kind="stable")
    near = [weighed[k] for k in order if k == order[0] or odds[weighed[k].of.name] > _RARE]
    said = of_modes(
        [told_together(one.posterior, one.mode, odds, WIDER_SOLID) for one in near],
        [one.mode.log_evidence for one in near],
    )
    best = modes[order[0]]
    return replace(said, laid=best.posterior.laid(best.mode.z, best.mode.found))


def _agreed(starts: Sequence[Start]) -> Start:
    """What estimates of one lump say in the middle. No surer than one of them: mostly they err alike."""
    logs = np.log([[one.d_mm, one.depth_mm, one.t_mm, one.E_kPa] for one in starts])
    d, depth, t, E = np.exp(logs.mean(0)).tolist()
    stiffness = float(np.mean([one.E_inv23 for one in starts]))
    sd = () if not all(one.sd for one in starts) else tuple(np.mean([one.sd for one in starts], 0).tolist())
    return replace(starts[0], d_mm=d, depth_mm=depth, t_mm=t, E_inv23=stiffness, E_kPa=E, sd=sd)


def _corrections(cases: Sequence[Case]) -> list[Correction]:
    """One for each case, computed once for forces that are nearly alike."""
    out: list[Correction] = []
    for case in cases:
        alike = [one for one in out if abs(np.log(one.case.F_rel / case.F_rel)) < _ALIKE]
        out.append(alike[0] if alike else correction_at(case, bundled()[0]))
    return out


def _take(modes: list[Found], found: Found | None) -> None:
    """Add a mode that is not there yet."""
    if found is not None and all(_moved(other, found) > _SAME for other in modes):
        modes.append(found)


def _near(modes: list[Found], rough: float = 0.0) -> list[Found]:
    """Those that explain the stroke about as well as the best, or worse by a part of its misfit."""
    least = min((one.mode.misfit.total for one in modes), default=0.0)
    return [one for one in modes if one.mode.misfit.total <= least + max(_AS_WELL, rough * least)]


def _searched(posterior: Together, forward: OverOneLump, z: Floats, hopeless: float = np.inf) -> Found | None:
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
