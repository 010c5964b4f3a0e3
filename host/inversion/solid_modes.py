"""The modes of solid classes over strokes: searches on the emulator, set right by the solver where they end.

Space mapping (Bandler and others 1994): the solver computes one stroke and its derivatives at the emulator's
mode; what it says otherwise is added to the emulator, and the search goes on from there, until the mode
stays. Units: mm, kPa.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.changing import CHANGE, LATER, as_changed
from palpate.inversion.classes import Class
from palpate.inversion.felt import FeltStroke
from palpate.inversion.joint import Together
from palpate.inversion.kept import Felt
from palpate.inversion.marginal import valley_along
from palpate.inversion.mirror import mirrored_about
from palpate.inversion.search import Mode, search
from palpate.inversion.solid_classes import HEIGHT, OFFSET, RATIO, WIDTH, learnt, moved, moving
from palpate.inversion.solid_correction import Correction, correction_at
from palpate.inversion.solid_emulator import bundled
from palpate.inversion.solid_forward import OverOneLump
from palpate.inversion.solid_posterior import SolidPosterior, binned
from palpate.inversion.start import MIDDLE, Start
from palpate.learn.emulator import ON_LINE_MM
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
_STIFFNESS = 2
"""Of the unknowns of a lump; the first is its size, the second its depth."""
_STEPS, _ENOUGH = 20, 1.0
_HOPELESS = 2.0
"""A start whose misfit is over the best one's by this part of it after some steps is not followed."""
_SOFT, _HARD = 0.45, 0.1
_SIZED, _LESS, _MORE = 1.3, -0.5, 0.4
"""Sizes of further first guesses, and ln of their glands' stiffness over the usual."""
_ROUNDS, _BESIDE_ROUNDS = 4, 3
"""The solver is asked so often, and so often beside the line, where a stroke costs it four times as much."""
_OTHER_ROUNDS = 1
"""On the line it is then asked about a lump of another stiffness, and so often about what is found there."""
_WORTH = 3.0
"""It is asked about modes whose evidence is within so much of the best one's, as a logarithm."""
_STAYS = 0.5
"""The mode stays where none of `_COUNTS` moves by so much of its standard deviation."""
_COUNTS = ("ln d", "ln depth", "E^-2/3", "ln t", f"{CHANGE} ln d", f"{CHANGE} ln depth")
_PLAINLY = 0.5
"""Tissue alone is not followed where its misfit is over the best lump's by more than this part of it."""
_THICK = 0.6, 1.0, 1.6
"""First guesses of the fat's thickness in tissue without a lump, over the estimate's."""
_AS_WELL, _SAME = 10.0, 0.5
"""Modes whose misfit is within so much of the best one's may be right, too. Those nearer than so many
standard deviations are one."""
_BESIDE_MM = 0.0, 2.0, 4.0, 6.0, 8.0
"""How far beside the line first guesses lie."""
_ROUGH = 0.1
"""Before the solver has set the emulator right a misfit says no more than this part of it."""
_ALIKE = 0.15
"""Logarithms of forces so near each other share what the solver says, ..."""
_ALIKE_MM = 1.5
"""... and lines so near each other."""
_IN_THE_MIDDLE_MM = 2.5
"""A bump whose middle is so near that of the face is looked for on the line."""

_MODEL = {"ln d": 0.025, WIDTH: 0.05, HEIGHT: 0.05, "ln depth": 0.025, "E^-2/3": 0.02, "ln_E": 0.025}
"""Standard deviations of what mesh and emulator, set right, get wrong, by unknown."""


@dataclass(frozen=True)
class Found:
    """A mode of a class, which each stroke may feel otherwise."""

    posterior: Together
    each: tuple[Class, ...]
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
        """What lies under each stroke, under its mean force, in fat of 10 kPa."""
        posterior, z = self.posterior, self.mode.z
        forces = [
            float(np.exp(np.log(part.forces(z[index])[part.stroke.press :]).mean()))
            for part, index in zip(posterior.parts, posterior.index)
        ]
        theta = z[: len(self.of.unknowns)]
        return [
            replace(of.case(theta), F_rel=force / FORCE_UNIT_N_PER_M) for of, force in zip(self.each, forces)
        ]


class Searches:
    """Searches of strokes over one lump.

    Parameters
    ----------
    start : Start
        What is said of the lump.
    visit : int, optional
        So many strokes are a first visit's: the others feel the class's `CHANGES`.
    shared : tuple of str
        As of `Together`.
    """

    def __init__(
        self,
        strokes: Sequence[Felt],
        start: Start,
        noise: Noise,
        visit: int | None = None,
        shared: tuple[str, ...] = (),
    ) -> None:
        self.start, self.noise, self.shared = start, noise, shared
        self.visit = len(strokes) if visit is None else visit
        self._alike = len(strokes) if visit is None else 1  # between two visits it cancels
        places = [mirrored_about(stroke) for stroke, _ in strokes]
        self.lumps_mm = [own.lump_mm if place is None else place for place, (_, own) in zip(places, strokes)]
        self.strokes = [binned(_thinned(stroke, at)) for (stroke, _), at in zip(strokes, self.lumps_mm)]
        emulator, errors = bundled()
        self._ratios, self._errors = emulator.learnt(_RATIO), len(errors.image)

    def lumps(self, classes: Sequence[Class]) -> list[Found]:
        """The modes of classes with a lump, set right; the later classes begin at the first's."""
        learnt = [self._learnt(moving(of, len(self.strokes))) for of in classes]
        modes = self._first(learnt)
        return [_widened(one) for one in self._set_right(modes, learnt)] if modes else []

    def plain(self, of: Class, misfit: float) -> list[Found]:
        """The modes of tissue without a lump, set right, where it may explain the strokes about as well."""
        of = self._learnt(of)
        thetas = []
        for by in _THICK:
            thetas.append(of.column("mean"))
            thetas[-1][0] = np.log(by * self.start.t_mm)
        modes = self._from(of, thetas)
        likely = bool(modes) and min(one.mode.misfit.total for one in modes) < (1 + _PLAINLY) * misfit
        return [_widened(one) for one in self._set_right(modes)] if likely else []

    def _learnt(self, of: Class) -> Class:
        return learnt(of, self._ratios, self._errors)

    def _each(self, of: Class) -> tuple[Class, ...]:
        """The class as each stroke feels it."""
        strokes = range(len(self.strokes))
        return tuple(as_changed(of, [moved(k), *(LATER if k >= self.visit else ())]) for k in strokes)

    def _first(self, classes: Sequence[Class]) -> list[Found]:
        """The modes by the emulator alone, from several starts."""
        modes: list[Found] = []
        for of in classes:
            guesses = [one.theta(of) for one in modes]
            modes += near(self._from(of, guesses) if modes else self._beside(of), _ROUGH)
        return modes

    def _set_right(self, modes: list[Found], classes: Sequence[Class] = ()) -> list[Found]:
        """The modes by an emulator that the solver sets right at the likeliest, until those stay.

        classes : sequence of Class
            With a lump, which may be as hard as the likeliest is soft, or as soft as it is hard.
        """
        asked: list[_Asked] = []
        beside = bool(classes) and abs(_best(modes).offset_mm) > ON_LINE_MM
        modes = self._asked_about(modes, asked, _BESIDE_ROUNDS if beside else _ROUNDS)
        if classes and asked and not beside:
            modes = self._asked_about(
                [*modes, *self._other_side(modes, asked, classes)], asked, _OTHER_ROUNDS
            )
        stays = _answered(_best(modes), asked)
        settled = [replace(one.mode, settled=one.mode.settled and stays) for one in modes]
        out = [replace(one, mode=mode) for one, mode in zip(modes, settled)]
        return [self._with_valley(one, asked) for one in near(out)] if classes else out

    def _with_valley(self, one: Found, asked: Sequence[_Asked]) -> Found:
        """The mode with what is as likely along the lump's stiffness."""
        forward = OverOneLump(one.each, self.strokes, _nearest(one, asked) if asked else ())
        valley = valley_along(one.posterior, forward, one.mode, _STIFFNESS)
        return replace(one, mode=replace(one.mode, valley=valley))

    def _asked_about(self, modes: list[Found], asked: list[_Asked], rounds: int) -> list[Found]:
        """The modes, after the solver has been asked about the likeliest so many times at most."""
        for _ in range(rounds):
            least = _best(modes).mode.log_evidence - _WORTH
            far = [one for one in near(modes) if one.mode.log_evidence >= least and not _answered(one, asked)]
            if not far:
                break
            one = _best(far)
            try:
                asked.append((one, _corrections(one.cases())))
            except (CaseError, StrokeError):
                break
            modes = self._again(modes, asked) or modes
        return modes

    def _other_side(
        self, modes: Sequence[Found], asked: list[_Asked], classes: Sequence[Class]
    ) -> list[Found]:
        """Modes near a lump of another stiffness that feels like the likeliest: the emulator, right at that
        one, is not there."""
        best = _best(modes)
        z = self._afresh(best)
        like = replace(self.start, d_mm=float(np.exp(z[0])), E_inv23=float(z[_STIFFNESS]))
        like = like.as_stiff(_HARD if like.E_inv23 > (_HARD + _SOFT) / 2 else _SOFT)
        z[0], z[_STIFFNESS] = np.log(like.d_mm), like.E_inv23
        there = self._searched(best.of, z, corrections=_nearest(best, asked), held=_STIFFNESS)
        if there is None:
            return []
        try:
            asked.append((there, _corrections(there.cases())))
        except (CaseError, StrokeError):
            return []
        out: list[Found] = []
        for of in classes:
            z = self._posterior(of).start(there.theta(of), self.start.E_kPa, self.lumps_mm)
            _take(out, self._searched(of, z, corrections=asked[-1][1]))
        return out

    def _again(self, modes: Sequence[Found], asked: Sequence[_Asked]) -> list[Found]:
        """The modes by the emulator set right as nearby as can be, from where they were."""
        out: list[Found] = []
        for name in dict.fromkeys(one.of.name for one in modes):
            of_class: list[Found] = []
            for one in (one for one in modes if one.of.name == name):
                z = self._afresh(one)
                _take(of_class, self._searched(one.of, z, corrections=_nearest(one, asked)))
            out += near(of_class)
        return out

    def _afresh(self, one: Found) -> Floats:
        """A mode as a guess: what the emulator gets wrong is another matter, once it is set right."""
        z, k = one.mode.z.copy(), len(one.of.unknowns)
        z[k - self._errors : k] = 0.0
        return z

    def _beside(self, of: Class) -> list[Found]:
        """A class's modes, searched from beside the line as the columns say or, where needed, elsewhere."""
        said = np.array([_across(one, at) for one, at in zip(self.strokes, self.lumps_mm)])
        middle = float(np.median(said))
        side = 1.0 if middle >= 0 else -1.0
        lines = [said + (y - middle) for y in dict.fromkeys((middle, *(side * y for y in _BESIDE_MM)))]
        one_each = self._from(of, [next(_starts(of, self.start, each)) for each in lines])
        if not one_each:
            return []
        best = min(one_each, key=lambda one: one.mode.misfit.total)
        modes = [near(one_each, _ROUGH)[0]]
        _take(modes, best)
        _, *others = _starts(of, self.start, said + (modes[0].offset_mm - said[0]))
        return self._from(of, others, modes)

    def _from(self, of: Class, thetas: Sequence[Floats], known: Sequence[Found] = ()) -> list[Found]:
        """A class's modes by the emulator alone, those known and others that guesses lead to."""
        modes = list(known)
        for theta in thetas:
            least = min((one.mode.misfit.total for one in modes), default=np.inf)
            z = self._posterior(of).start(theta, self.start.E_kPa, self.lumps_mm)
            _take(modes, self._searched(of, z, (1 + _HOPELESS) * least))
        return modes

    def _posterior(self, of: Class) -> Together:
        return Together(
            [SolidPosterior(of, one, self.noise, self._alike) for one in self.strokes], self.shared
        )

    def _searched(
        self,
        of: Class,
        z: Floats,
        hopeless: float = np.inf,
        corrections: Sequence[Correction] = (),
        held: int | None = None,
    ) -> Found | None:
        posterior, each = self._posterior(of), self._each(of)
        forward = OverOneLump(each, self.strokes, corrections)
        try:
            mode = search(posterior, forward, z, _STEPS, enough=_ENOUGH, hopeless=hopeless, held=held)
        except (CaseError, StrokeError):
            return None
        return Found(posterior, each, mode)


_Asked = tuple[Found, list[Correction]]
"""A mode at which the solver was asked, and what it said."""


def _answered(one: Found, asked: Sequence[_Asked]) -> bool:
    """Whether the solver was asked nearby."""
    return any(_moved(there, one) < _STAYS for there, _ in asked)


def _nearest(one: Found, asked: Sequence[_Asked]) -> list[Correction]:
    """What the solver said nearest to a mode."""
    return min(asked, key=lambda there: _moved(there[0], one))[1]


def _corrections(cases: Sequence[Case]) -> list[Correction]:
    """One for each case, computed once for one lump under forces and along lines that are nearly alike."""
    out: list[Correction] = []
    for k, case in enumerate(cases):
        alike = [
            one
            for one, other in zip(out, cases[:k])
            if replace(other, F_rel=case.F_rel, offset_mm=case.offset_mm) == case
            and abs(np.log(one.case.F_rel / case.F_rel)) < _ALIKE
            and abs(one.case.offset_mm - case.offset_mm) < _ALIKE_MM
        ]
        out.append(alike[0] if alike else correction_at(case, bundled()[0]))
    return out


def _widened(one: Found) -> Found:
    """With what emulator and mesh get wrong."""
    at = {unknown.name: k for k, unknown in enumerate(one.of.unknowns)}
    at["ln_E"] = one.posterior.at["ln_E"].start
    more = np.zeros(one.posterior.size)
    for name, sd in _MODEL.items():
        if name in at:
            more[at[name]] = sd**2
    mode, wrong = one.mode, np.diag(more)
    valley = mode.valley and replace(mode.valley, covariances=mode.valley.covariances + wrong)
    return replace(one, mode=replace(mode, covariance=mode.covariance + wrong, valley=valley))


def _take(modes: list[Found], found: Found | None) -> None:
    """Add a mode that is not there yet."""
    if found is not None and all(_moved(other, found) > _SAME for other in modes):
        modes.append(found)


def near(modes: Sequence[Found], rough: float = 0.0) -> list[Found]:
    """Those that explain the stroke about as well as the best, or worse by a part of its misfit."""
    least = min((one.mode.misfit.total for one in modes), default=0.0)
    return [one for one in modes if one.mode.misfit.total <= least + max(_AS_WELL, rough * least)]


def _starts(of: Class, start: Start, offsets_mm: Floats) -> Iterator[Floats]:
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
        theta[names.index(OFFSET)] = offsets_mm[0]
        for k, offset in enumerate(offsets_mm[1:], start=1):
            theta[names.index(moved(k))] = offset - offsets_mm[0]
        theta[names.index(RATIO)] += ratio
        yield theta


def _across(stroke: FeltStroke, lump_mm: float) -> float:
    """Where across the face more is felt over the lump than elsewhere, mm; 0 near its middle."""
    p = stroke.press
    assert stroke.image_kPa is not None
    columns = np.nanmean(stroke.image_kPa[p:], axis=1)
    columns = columns / np.nanmean(columns, axis=1, keepdims=True)
    over = np.abs(stroke.place_mm[p:] - lump_mm) < _NEAR_MM / 2
    if not over.any() or over.all():
        return 0.0
    more = np.maximum(np.nan_to_num(columns[over].mean(0) - columns[~over].mean(0)), 0.0) ** 2
    middle = float(more @ COLUMN_MM / max(more.sum(), 1e-12))
    return middle if abs(middle) > _IN_THE_MIDDLE_MM else 0.0


def _thinned(stroke: FeltStroke, lump_mm: float) -> FeltStroke:
    """Every frame near the lump, some of the others."""
    p, n = stroke.press, len(stroke.place_mm) - stroke.press
    number = np.arange(n)
    chosen = np.flatnonzero((np.abs(stroke.place_mm[p:] - lump_mm) < _NEAR_MM) | (number % _THIN == 0))
    return stroke.take(np.arange(_THIN - 1, p, _THIN), chosen)


def _best(modes: Sequence[Found]) -> Found:
    """The likeliest."""
    return max(modes, key=lambda found: found.mode.log_evidence)


def _moved(before: Found, now: Found) -> float:
    """How far the numbers that count went, in standard deviations."""
    names = [unknown.name for unknown in now.of.unknowns]
    k = [names.index(name) for name in _COUNTS if name in names]
    sd = np.sqrt(np.diag(now.mode.covariance)[k])
    return float((np.abs(now.mode.z[k] - before.theta(now.of)[k]) / sd).max())
