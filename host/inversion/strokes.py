"""Inverting strokes: the usual mesh with some frames under every class, then the fine one with the best."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.answer.fitted import Inverted
from palpate.errors import UsageError
from palpate.inversion.classes import ANYWHERE, BORDER, CLASSES
from palpate.inversion.departures import RARE, TWO_LUMPS, odds_of_departures
from palpate.inversion.felt import FeltStroke, NotInvertible
from palpate.inversion.forward import Emulates
from palpate.inversion.found import Found
from palpate.inversion.kept import Felt
from palpate.inversion.marginal import with_sides
from palpate.inversion.modes import coarse, finest
from palpate.inversion.press import invert_press
from palpate.inversion.recorded import felt_strokes
from palpate.inversion.result import SURE, told_of_modes
from palpate.inversion.solids import invert_solid
from palpate.inversion.start import Start
from palpate.inversion.two_lumps import AsTwo, as_two
from palpate.inversion.under import AUTO, classes_over, odds_of
from palpate.link.face import Face
from palpate.sim.probe.noise import Noise, level_named
from palpate.sim.tissue.one_thread import one_blas_thread

KINDS = (AUTO, *CLASSES)
_MAYBE = float(np.log(0.01))
"""Two lumps that are as likely to first order are fitted."""


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


@one_blas_thread()
def invert_together(strokes: Sequence[Felt], noise: Noise, kind: str = AUTO) -> Inverted:
    """Invert strokes over one lump: they share it and the tissue; places, forces and gains are their own."""
    number = strokes[0][0].stroke
    if any(stroke.solid for stroke, _ in strokes):
        if kind == AUTO:
            return invert_solid(strokes, noise)
        problem = (
            f"stroke {number}: its image changes across the stroke, as over a ball; --class {kind} is for "
            "others"
        )
        return Inverted(number, problem=problem)
    tried: dict[str, list[Found]] = {}
    for of in classes_over(strokes[0][0], kind):
        if modes := coarse(of, strokes, noise, tried):
            tried[of.name] = modes
    if not tried:
        return Inverted(number, problem=f"stroke {number}: no class of tissue and lump could be computed")
    odds = odds_of((name, one.mode.log_evidence) for name, modes in tried.items() for one in modes)
    best = max(odds, key=lambda name: odds[name])
    if best == BORDER.name and ANYWHERE.name in tried:
        # which holds it: a tie that is only nearly there would make intervals too narrow
        best = ANYWHERE.name
    modes = finest(strokes, noise, tried[best])
    first = modes[0]
    others = odds_of_departures(first.posterior, first.mode, first.forward)
    maybe = others.get(TWO_LUMPS, -np.inf) > _MAYBE and isinstance(first.forward, Emulates)
    two, over_one = as_two(noise, tried[best], first) if maybe else AsTwo([], None)
    if over_one is not None:
        others[TWO_LUMPS] = RARE + over_one
    all_of_them = float(np.logaddexp.reduce([0.0, *others.values()]))
    odds = {name: share * float(np.exp(-all_of_them)) for name, share in odds.items()}
    odds |= {name: float(np.exp(share - all_of_them)) for name, share in others.items()}
    if kind == AUTO and two and odds[TWO_LUMPS] > SURE:
        modes, first = two, two[0]
    if isinstance(first.forward, Emulates):
        modes = [with_sides(one) for one in modes]
    said = told_of_modes(modes, odds)
    return replace(said, laid=first.posterior.laid(first.mode.z, first.mode.found))
