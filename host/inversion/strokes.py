"""Inverting strokes: the coarse mesh with some frames under every class, then the fine one with the best."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.answer.fitted import Inverted
from palpate.errors import UsageError
from palpate.inversion.classes import ANYWHERE, BORDER, CLASSES, Class
from palpate.inversion.departures import odds_of_departures
from palpate.inversion.felt import FeltStroke, NotInvertible
from palpate.inversion.forward import COARSE, FINE, Forward
from palpate.inversion.joint import Together
from palpate.inversion.kept import Felt
from palpate.inversion.mirror import mirrored_about
from palpate.inversion.posterior import SINGLE, Posterior
from palpate.inversion.press import invert_press
from palpate.inversion.recorded import felt_strokes
from palpate.inversion.result import FITS, told
from palpate.inversion.search import Mode, search
from palpate.inversion.solids import invert_solid
from palpate.inversion.start import MIDDLE, Start
from palpate.inversion.under import AUTO, classes_over, forward_of, odds_of
from palpate.link.face import Face
from palpate.sim.probe.noise import Noise, level_named
from palpate.sim.tissue import CaseError, Settings, StrokeError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

KINDS = (AUTO, *CLASSES)
_NEAR_MM = 16.0
"""Farther from the lump every fourth frame will do."""
_ELSEWHERE_MM = 4.0
"""A first estimate whose lump is so far from the stroke's is not of that lump."""
_ILL = 1.3
_COARSE_STEPS, _FINE_STEPS = 10, 7
_COARSE_ENOUGH, _FINE_ENOUGH = 4.0, 2.0
"""The coarse mesh need not be followed to the bottom: the fine one's lies elsewhere."""
_HOPELESS = 6.0
"""A class whose misfit is so many times the data's number is not followed further."""
_LOST = 2.0
"""The same on the fine mesh."""


def invert(
    recording: str | Path | Sequence[str | Path],
    kind: str = AUTO,
    noise: Noise | str = "typical",
    face: Face | None = None,
    *,
    together: bool = False,
) -> Iterator[Inverted]:
    """Invert every stroke of recordings, or every press where there is no stroke, one after the other.

    Parameters
    ----------
    recording : str, Path, or sequence of them
        .mcap files of `palpate stream --record`.
    kind : str
        One of `KINDS`: the class of tissue and lump, or `auto` for the one with the best odds.
    noise : Noise or str
        Of the sensors and the hand: a level's name, or a file sensor.toml of `palpate characterise`.
    face : palpate.link.face.Face, optional
        Of somebody's array, where the port that was recorded does not describe it.
    together : bool
        All strokes go over one lump: one answer for them all.

    Yields
    ------
    Inverted
        With `problem` where the stroke cannot be inverted.

    Raises
    ------
    PalpateError
        The recording cannot be read, or the class or level is not known.
    """
    if kind not in KINDS:
        raise UsageError(f"there is no class {kind!r}; there are {', '.join(KINDS)}")
    level = level_named(noise) if isinstance(noise, str) else noise
    paths = [recording] if isinstance(recording, (str, Path)) else list(recording)
    whole: list[Felt] = []
    for stroke, start in (pair for path in paths for pair in felt_strokes(path, face)):
        if isinstance(stroke, NotInvertible):
            yield Inverted(start.stroke, problem=str(stroke))
        elif together and not stroke.alone:
            whole.append((stroke, start))
        else:
            yield invert_stroke(stroke, start, level, kind)
    if whole:
        yield invert_together(whole, level, kind)


def invert_stroke(stroke: FeltStroke, start: Start, noise: Noise, kind: str = AUTO) -> Inverted:
    """Invert one stroke from a first estimate, or one press; as `invert`."""
    return (
        invert_press(stroke, noise, kind) if stroke.alone else invert_together([(stroke, start)], noise, kind)
    )


def invert_together(strokes: Sequence[Felt], noise: Noise, kind: str = AUTO) -> Inverted:
    """Invert strokes over one lump: they share it and the tissue; places, forces and gains are their own."""
    if any(stroke.solid for stroke, _ in strokes):
        if len(strokes) == 1 and kind == AUTO:
            return invert_solid(*strokes[0], noise)
        number, asked = strokes[0][0].stroke, "several together" if len(strokes) > 1 else f"--class {kind}"
        problem = (
            f"stroke {number}: its image changes across the stroke, as over a ball; {asked} is for others"
        )
        return Inverted(number, problem=problem)
    tried: dict[str, Found] = {}
    for of in classes_over(strokes[0][0], kind):
        found = coarse(of, strokes, noise, tried)
        if found is not None:
            tried[of.name] = found
    number = strokes[0][0].stroke
    if not tried:
        return Inverted(number, problem=f"stroke {number}: no class of tissue and lump could be computed")
    odds = odds_of({name: found.mode.log_evidence for name, found in tried.items()})
    best = max(odds, key=lambda name: odds[name])
    if best == BORDER.name and ANYWHERE.name in tried:
        # which holds it: a tie that is only nearly there would make intervals too narrow
        best = ANYWHERE.name
    found = tried[best]
    found = finest(strokes, noise, found)
    others = odds_of_departures(found.posterior, found.mode, found.forward)
    sum_of_all = 1 + sum(others.values())
    odds = {name: share / sum_of_all for name, share in {**odds, **others}.items()}
    index = found.posterior.index[0]
    own = replace(found.mode, z=found.mode.z[index], covariance=found.mode.covariance[np.ix_(index, index)])
    said = told(found.posterior.parts[0], own, odds, found.posterior.places(found.mode.z))
    said = replace(said, laid=found.posterior.laid(found.mode.z, found.mode.found))
    return said if len(strokes) == 1 else replace(said, together=len(strokes), centre_mm=None)


@dataclass(frozen=True)
class Found:
    """A class's best mode on one mesh."""

    posterior: Together
    forward: Forward
    mode: Mode
    kept: list[Ints]
    """The frames of each stroke that were used."""


Assemble = Callable[[Sequence[Posterior], Settings], tuple[Together, Forward]]
"""Makes one posterior of several strokes', and what computes their frames."""


def one_lump(parts: Sequence[Posterior], settings: Settings) -> tuple[Together, Forward]:
    """Of strokes over one lump."""
    return Together(parts), forward_of(parts[0].of, settings, [part.stroke for part in parts])


def coarse(
    of: Class,
    strokes: Sequence[Felt],
    noise: Noise,
    tried: Mapping[str, Found],
    assemble: Assemble = one_lump,
    again: bool = False,
) -> Found | None:
    """The best mode of a class from the first start that fits; None where no start can be computed.

    again : bool
        From all starts but the first.
    """
    best: Found | None = None
    hopeless = np.inf
    if tried:
        hopeless = 3 * min(found.mode.misfit.total for found in tried.values()) + 200
    placed = [_placed(stroke, start) for stroke, start in strokes]
    starts = [some[0] for some in placed]
    taken = [
        _thinned(stroke, start.lump_mm, press=6, near=3, far=4) for (stroke, _), start in zip(strokes, starts)
    ]
    for theta in islice(_starts(of, placed[0], tried), int(again), None):
        posterior, forward = assemble([Posterior(of, some, noise, COARSE.hx_mm) for some, _ in taken], COARSE)
        E_kPa = float(np.median([start.E_kPa for start in starts]))
        try:
            z = posterior.joined([
                part.start(theta, E_kPa, start.lump_mm) for part, start in zip(posterior.parts, starts)
            ])  # fmt: skip
            mode = search(posterior, forward, z, _COARSE_STEPS, enough=_COARSE_ENOUGH, hopeless=hopeless)
        except (CaseError, StrokeError):
            continue
        if best is None or mode.misfit.total < best.mode.misfit.total:
            best = Found(posterior, forward, mode, [kept for _, kept in taken])
        enough = best.mode.chi2 < _ILL and not again
        if enough or not of.lump or (tried and best.mode.misfit.total > hopeless):
            break
    return best


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


def _starts(of: Class, starts: Sequence[Start], tried: Mapping[str, Found]) -> Iterator[Floats]:
    """First guesses: what a class that fits has found, else the estimates, softer and harder ones."""
    if of.name != ANYWHERE.name and ANYWHERE.name in tried:
        mode = tried[ANYWHERE.name].mode
        known = dict(zip((u.name for u in tried[ANYWHERE.name].posterior.of.unknowns), mode.z))
        if mode.chi2 < _ILL:
            yield np.array([known[unknown.name] for unknown in of.unknowns])
            return
    yield from (next(start.thetas(of)) for start in starts)
    yield from islice(starts[0].thetas(of), 1, None)


def _fine(strokes: Sequence[Felt], noise: Noise, found: Found, assemble: Assemble) -> Found:
    """Go on from the coarse mesh's mode with more frames on the fine one; as before where that fails."""
    of, parts, zs, kept = found.posterior.of, [], [], []
    for (stroke, _), part, index, before in zip(
        strokes, found.posterior.parts, found.posterior.index, found.kept
    ):
        own = found.mode.z[index]
        more, now = _thinned(stroke, part.one(own, "start"), press=6, near=1, far=4)
        parts.append(Posterior(of, more, noise, FINE.hx_mm))
        zs.append(_carried(part, own, before, parts[-1], now))
        kept.append(now)
    posterior, forward = assemble(parts, FINE)
    try:
        mode = search(
            posterior, forward, posterior.joined(zs), _FINE_STEPS, enough=_FINE_ENOUGH, damping=1e-3,
            hopeless=_LOST * posterior.measured,
        )  # fmt: skip
    except (CaseError, StrokeError):
        return found
    return Found(posterior, forward, mode, kept)


def finest(strokes: Sequence[Felt], noise: Noise, first: Found, assemble: Assemble = one_lump) -> Found:
    """The mode on the fine mesh; where it does not fit, of that and of what other starts lead to the better.

    The coarse mesh's errors hide a wrong lump.
    """
    best = first
    if first.mode.chi2 < _HOPELESS:  # what the coarse mesh does not explain at all needs no finer one
        best = _fine(strokes, noise, first, assemble)
    if best.mode.chi2 < FITS or not best.posterior.of.lump:
        return best
    other = coarse(first.posterior.of, strokes, noise, {}, assemble, again=True)
    if other is not None and other.mode.chi2 < _HOPELESS:
        other = _fine(strokes, noise, other, assemble)
        best = min(best, other, key=lambda found: found.mode.chi2)
    return best


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


def _thinned(stroke: FeltStroke, lump_mm: float, press: int, near: int, far: int) -> tuple[FeltStroke, Ints]:
    """Every so-manieth frame, and their numbers: the lump is what the others are compared with."""
    p, n = stroke.press, len(stroke.place_mm) - stroke.press
    number = np.arange(n)
    close = np.abs(stroke.place_mm[p:] - lump_mm) < _NEAR_MM
    chosen = np.flatnonzero(np.where(close, number % near == 0, number % far == 0))
    pressed = np.arange(press - 1, p, press)
    return stroke.take(pressed, chosen), np.concatenate([pressed, p + chosen])
