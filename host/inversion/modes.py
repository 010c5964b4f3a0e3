"""The modes of one class over strokes: searches from several starts on the usual mesh, then on the fine one.

Where the border of fat and gland runs is what a stroke tells least: a lump in the fat, across the border and
in the gland may all explain it. So each is looked for. Units: mm, kPa.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.classes import ANYWHERE, Class
from palpate.inversion.emulated import emulates
from palpate.inversion.felt import FeltStroke
from palpate.inversion.forward import COARSE, FINE
from palpate.inversion.found import Assemble, Found, distinct, one_lump
from palpate.inversion.kept import Felt
from palpate.inversion.mirror import mirrored_about
from palpate.inversion.posterior import EMULATED, FINE_MESH, SINGLE, USUAL_MESH, Posterior
from palpate.inversion.result import FITS
from palpate.inversion.search import search
from palpate.inversion.set_right import set_right
from palpate.inversion.start import MIDDLE, Start, with_other_borders
from palpate.sim.probe.noise import Noise
from palpate.sim.tissue import CaseError, StrokeError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_NEAR_MM, _MOST_NEAR, _ALIKE_MM = 24.0, 40, 1.0
"""So far from the lump, half the face and half a wide lump, it is near; so many frames are enough there;
those so far apart are alike."""
_BY_EMULATOR, _COARSELY, _FINELY = (3, 1, 3), (6, 3, 4), (6, 1, 4)
"""So-manieth frame of the press counts, and means of so many near the lump and far from it: for the emulator,
and for the solver on the usual mesh and the fine one."""
_ELSEWHERE_MM = 4.0
"""A first estimate whose lump is so far from the stroke's is not of that lump."""
_ILL = 1.3
_COARSE_STEPS, _FINE_STEPS = 10, 7
_COARSE_ENOUGH, _FINE_ENOUGH = 4.0, 2.0
"""The coarse mesh need not be followed to the bottom: the fine one's lies elsewhere."""
EMULATED_STEPS, EMULATED_ENOUGH = 20, 4.0
_E_STEPS = np.exp(np.linspace(-1.5, 1.5, 9))
_STRIDE = 2.0
"""With its border moved a mode is far from where it leads to: steps are longer."""
_HOPELESS = 6.0
"""A class whose misfit is so many times the data's number is not followed further."""
_LOST = 2.0
"""The same on the fine mesh."""
_NEARLY, _MOST = 30.0, 3
"""Modes whose misfit on the usual mesh is within so much of the best one's, a stroke, are looked at on the
fine one: so much the mesh may get wrong."""
_AS_WELL = 9.0
"""A mode whose evidence is within so much of the best one's, as a logarithm, may be the one."""


def coarse(
    of: Class,
    strokes: Sequence[Felt],
    noise: Noise,
    tried: Mapping[str, Sequence[Found]],
    assemble: Assemble = one_lump,
) -> list[Found]:
    """The modes of a class on the usual mesh, the best first; none where no start can be computed.

    tried : mapping of sequences of Found
        Of the classes before, by name.
    """
    hopeless = min((3 * one[0].mode.misfit.total + 200 for one in tried.values()), default=np.inf)
    searches = _Coarse(of, strokes, noise, assemble, hopeless)
    known = tried.get(ANYWHERE.name, ())
    if known and known[0].mode.chi2 < _ILL:
        names = [unknown.name for unknown in known[0].posterior.of.unknowns]
        mode = dict(zip(names, known[0].mode.z))
        searches.go_on([np.array([mode[unknown.name] for unknown in of.unknowns])])
        return searches.modes
    if not (of.lump and searches.emulated):  # else it is among the others
        searches.go_on([searches.starts[0].theta(of)])
    if of.lump and (searches.emulated or not _fit(searches.modes)):
        searches.go_on(searches.others())
    searches.move_border()
    return searches.modes


def _fit(modes: Sequence[Found]) -> bool:
    """Whether the best of them does on the usual mesh."""
    return bool(modes) and modes[0].mode.chi2 < _ILL


class _Coarse:
    """Searches on the usual mesh, one after the other; each lump that they find is kept once.

    Attributes
    ----------
    modes : list of Found
        The best first.
    starts : list of Start
        Of each stroke, where the stroke itself says that the lump lies.
    """

    def __init__(
        self, of: Class, strokes: Sequence[Felt], noise: Noise, assemble: Assemble, hopeless: float
    ) -> None:
        placed = [_placed(stroke, start) for stroke, start in strokes]
        self.starts = [some[0] for some in placed]
        self.modes: list[Found] = []
        self._of, self._of_first, self._assemble, self._hopeless = of, placed[0], assemble, hopeless
        self.emulated = emulates(of)
        how = _BY_EMULATOR if self.emulated else _COARSELY
        taken = [_gathered(stroke, start.lump_mm, *how) for (stroke, _), start in zip(strokes, self.starts)]
        error = EMULATED if self.emulated else USUAL_MESH
        self._parts = [Posterior(of, some, noise, error) for some, _ in taken]
        self._kept = [kept for _, kept in taken]

    def others(self) -> Iterator[Floats]:
        """Further guesses (k,) where the first one leads to nothing that fits."""
        if self.emulated:
            for start in self._of_first:
                yield from start.everywhere(self._of)
            return
        yield from self._of_first[0].softer_and_harder(self._of)
        for start in self._of_first[1:]:
            yield start.theta(self._of)

    def go_on(self, thetas: Iterable[Floats]) -> None:
        """Search from each of the guesses (k,)."""
        for theta in thetas:
            self._search(self._begin(theta, self._E_kPa))

    def _begin(self, theta: Floats, E_kPa: float) -> list[Floats]:
        """Each stroke's own numbers where a search begins."""
        return [part.start(theta, E_kPa, start.lump_mm) for part, start in zip(self._parts, self.starts)]

    @cached_property
    def _E_kPa(self) -> float:
        """The fat's modulus to begin with: the estimate, or what fits far better where emulating is cheap."""
        said = float(np.median([start.E_kPa for start in self.starts]))
        if not self.emulated:
            return said
        theta = self.starts[0].theta(self._of)
        posterior, forward = self._assemble(self._parts, None)
        misfits = {}
        for E_kPa in (said * _E_STEPS).tolist():
            z = posterior.joined(self._begin(theta, E_kPa))
            try:
                found = forward(theta, posterior.places(z), posterior.forces(z))
            except CaseError:
                continue
            misfits[E_kPa] = float(np.nan_to_num(posterior.misfit(z, found).total, nan=np.inf))
        return min(misfits, key=lambda E_kPa: misfits[E_kPa], default=said)

    def move_border(self) -> None:
        """Search from the best mode with its lump in the fat, across the border and in the gland."""
        if not self.modes:
            return
        best = self.modes[0]
        for theta in with_other_borders(self._of, best.mode.z[best.posterior.at["tissue"]]):
            z = best.mode.z.copy()
            z[best.posterior.at["tissue"]] = theta
            self._search(
                [z[index] for index in best.posterior.index],
                best=self.modes[0].mode.misfit.total,
                stride=_STRIDE,
            )

    def _search(self, own: Sequence[Floats], best: float = np.inf, stride: float = 1.0) -> None:
        posterior, forward = self._assemble(self._parts, None if self.emulated else COARSE)
        steps, enough = (
            (EMULATED_STEPS, EMULATED_ENOUGH) if self.emulated else (_COARSE_STEPS, _COARSE_ENOUGH)
        )
        if self.emulated:
            best = np.inf
        try:
            mode = search(
                posterior, forward, posterior.joined(own), steps, enough=enough,
                hopeless=self._hopeless, best=best, stride=stride,
                least=1.0 if self.emulated else _COARSE_ENOUGH,
            )  # fmt: skip
        except (CaseError, StrokeError):
            return
        found = Found(posterior, forward, mode, self._kept)
        self.modes = distinct([*self.modes, found], lambda one: one.mode.misfit.total)


def _placed(stroke: FeltStroke, start: Start) -> list[Start]:
    """First estimates where the stroke itself says that the lump lies."""
    place = mirrored_about(stroke)
    if place is None:
        return [start]
    here = replace(start, lump_mm=place)
    if abs(place - start.lump_mm) < _ELSEWHERE_MM:
        return [here]
    # what the estimate says of a lump it has from another part of the stroke
    return [here, replace(here, d_mm=MIDDLE.d_mm, depth_mm=MIDDLE.depth_mm, E_inv23=MIDDLE.E_inv23)]


def finest(
    strokes: Sequence[Felt], noise: Noise, modes: Sequence[Found], assemble: Assemble = one_lump
) -> list[Found]:
    """The modes on the fine mesh that may be the one, the best first.

    Those that explain the strokes about as well as the best on the usual mesh are followed; all where
    none of these fits: the usual mesh's errors hide a wrong lump.
    """
    least = modes[0].mode.misfit.total + _NEARLY * len(strokes)
    near = [one for one in modes if one.mode.misfit.total <= least]
    fine = _followed(strokes, noise, near, assemble)
    of = modes[0].posterior.of
    if of.lump and not any(one.mode.chi2 < FITS for one in fine):
        others = _Coarse(of, strokes, noise, assemble, np.inf)
        if _fit(modes) and not others.emulated:  # else they have been tried
            others.go_on(others.others())
        fine += _followed(strokes, noise, [*modes[len(near) :], *others.modes], assemble)
    fine = distinct(fine, lambda one: -one.mode.log_evidence) or [modes[0]]
    return [one for one in fine if one.mode.log_evidence >= fine[0].mode.log_evidence - _AS_WELL]


def _followed(
    strokes: Sequence[Felt], noise: Noise, modes: Sequence[Found], assemble: Assemble
) -> list[Found]:
    """On the fine mesh, but for those that it would not explain either, or that it cannot compute."""
    likely = [one for one in modes if one.mode.chi2 < _HOPELESS]
    if likely and emulates(likely[0].posterior.of):
        return set_right(noise, likely, assemble)
    there = [_fine(strokes, noise, one, assemble) for one in likely[:_MOST]]
    return [one for one in there if one is not None]


def _fine(strokes: Sequence[Felt], noise: Noise, found: Found, assemble: Assemble) -> Found | None:
    """Go on from a mode with more frames on the fine mesh."""
    of, parts, zs, kept = found.posterior.of, [], [], []
    for (stroke, _), part, index, before in zip(
        strokes, found.posterior.parts, found.posterior.index, found.kept
    ):
        own = found.mode.z[index]
        more, now = _gathered(stroke, part.one(own, "start"), *_FINELY)
        parts.append(Posterior(of, more, noise, FINE_MESH))
        zs.append(_carried(part, own, before, parts[-1], now))
        kept.append(now)
    posterior, forward = assemble(parts, FINE)
    try:
        mode = search(
            posterior, forward, posterior.joined(zs), _FINE_STEPS, enough=_FINE_ENOUGH, damping=1e-3,
            hopeless=_LOST * posterior.measured,
        )  # fmt: skip
    except (CaseError, StrokeError):
        return None
    return Found(posterior, forward, mode, kept)


def _carried(part: Posterior, z: Floats, before: Ints, other: Posterior, now: Ints) -> Floats:
    """A guess for other frames of the same stroke."""
    out = other.start(z[part.at["tissue"]], float(np.exp(part.one(z, "ln_E"))), part.one(z, "start"))
    for name in (*SINGLE, "gain", "offset"):
        out[other.at[name]] = z[part.at[name]]
    force = np.log(np.maximum(part.stroke.rows_kPa.sum(1), 1.0))
    apart = z[part.at["force"]] - force
    out[other.at["force"]] = np.log(np.maximum(other.stroke.rows_kPa.sum(1), 1.0)) + np.interp(
        now, before, apart
    )
    known = dict(zip(before[part.stroke.press :].tolist(), z[part.at["place"]]))
    out[other.at["place"]] = [known.get(k, 0.0) for k in now[other.stroke.press :].tolist()]
    return out


def _gathered(stroke: FeltStroke, lump_mm: float, press: int, near: int, far: int) -> tuple[FeltStroke, Ints]:
    """Some frames of the press and means of so many others, and the first ones' numbers."""
    p = stroke.press
    close = np.abs(stroke.place_mm[p:] - lump_mm) < _NEAR_MM
    close[0] = True  # the press stands there
    near = max(near, -(-int(close.sum()) // _MOST_NEAR))
    groups = [_alike(group, stroke.place_mm[p:]) for group in _runs(np.flatnonzero(close), near)]
    groups += _runs(np.flatnonzero(~close), far)
    groups.sort(key=lambda group: int(group[0]))
    pressed = np.arange(press - 1, p, press)  # not means: over rising forces they are no frame's
    first = np.append(pressed, [p + int(group[0]) for group in groups])
    return stroke.means(list(pressed[:, None]), groups), first


def _alike(group: Ints, place_mm: Floats) -> Ints:
    """What of a group feels the lump like its middle."""
    return group[np.abs(place_mm[group] - place_mm[group[len(group) // 2]]) < _ALIKE_MM]


def _runs(numbers: Ints, most: int) -> list[Ints]:
    """Neighbours together, `most` at the most."""
    whole = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return [group for run in whole if len(run) for group in np.array_split(run, -(-len(run) // most))]
