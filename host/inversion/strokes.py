"""Inverting strokes: the coarse mesh with some frames under every class, then the fine one with the best."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import UsageError
from palpate.inversion.classes import ANYWHERE, BORDER, CLASSES, NONE, Class
from palpate.inversion.felt import FeltStroke, NotInvertible
from palpate.inversion.forward import COARSE, FINE
from palpate.inversion.posterior import SINGLE, Posterior
from palpate.inversion.press import invert_press
from palpate.inversion.recorded import felt_strokes
from palpate.inversion.result import Inverted, told
from palpate.inversion.search import Mode, search
from palpate.inversion.start import Start
from palpate.inversion.under import AUTO, classes_over, forward_of, odds_of
from palpate.link.face import Face
from palpate.sim.probe.noise import Noise, level_named
from palpate.sim.tissue import CaseError, StrokeError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

KINDS = (AUTO, *CLASSES)
_NEAR_MM = 18.0
"""Farther from the lump every third or fourth frame will do."""
_ILL = 1.3
_COARSE_STEPS, _FINE_STEPS = 10, 4
_HOPELESS = 6.0
"""A class whose misfit is so many times the data's number after some steps is not followed further."""


def invert(
    recording: str | Path, kind: str = AUTO, noise: Noise | str = "typical", face: Face | None = None
) -> Iterator[Inverted]:
    """Invert every stroke of a recording, or every press where it has no stroke, one after the other.

    Parameters
    ----------
    recording : str or Path
        An .mcap file of `palpate stream --record`.
    kind : str
        One of `KINDS`: the class of tissue and lump, or `auto` for the one with the best odds.
    noise : Noise or str
        Of the sensors and the hand: a level's name, or a file sensor.toml of `palpate characterise`.
    face : palpate.link.face.Face, optional
        Of somebody's array, where the port that was recorded does not describe it.

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
    for stroke, start in felt_strokes(recording, face):
        if isinstance(stroke, NotInvertible):
            yield Inverted(start.stroke, problem=str(stroke))
        else:
            yield invert_stroke(stroke, start, level, kind)


def invert_stroke(stroke: FeltStroke, start: Start, noise: Noise, kind: str = AUTO) -> Inverted:
    """Invert one stroke from a first estimate, or one press; as `invert`."""
    if stroke.alone:
        return invert_press(stroke, noise, kind)
    some, kept = _thinned(stroke, start.lump_mm, press=4, near=2, far=4)
    tried: dict[str, tuple[Posterior, Mode]] = {}
    for of in classes_over(stroke, kind):
        found = _coarse(of, some, start, noise, tried)
        if found is not None:
            tried[of.name] = found
    if not tried:
        return Inverted(
            stroke.stroke, problem=f"stroke {stroke.stroke}: no class of tissue and lump could be computed"
        )
    odds = odds_of({name: mode.log_evidence for name, (_, mode) in tried.items()})
    best = max(odds, key=lambda name: odds[name])
    if best == BORDER.name and ANYWHERE.name in tried:
        best = (
            ANYWHERE.name
        )  # which holds it: a tie that is only nearly there would make intervals too narrow
    posterior, mode = tried[best]
    if mode.chi2 < _HOPELESS:  # what the coarse mesh does not explain at all needs no finer one
        posterior, mode = _fine(stroke, start, noise, posterior, mode, kept)
    return told(posterior, mode, odds)


def _coarse(
    of: Class, some: FeltStroke, start: Start, noise: Noise, tried: dict[str, tuple[Posterior, Mode]]
) -> tuple[Posterior, Mode] | None:
    """The best mode of a class from several starts; None where no start can be computed."""
    best: tuple[Posterior, Mode] | None = None
    hopeless = np.inf
    if tried:
        hopeless = 3 * min(mode.misfit.total for _, mode in tried.values()) + 200
    for theta in start.thetas(of):
        posterior = Posterior(of, some, noise, COARSE.hx_mm)
        try:
            z = posterior.start(theta, start.E_kPa, start.lump_mm)
            mode = search(
                posterior, forward_of(of, COARSE, some), z, _COARSE_STEPS, enough=2.0, hopeless=hopeless
            )
        except (CaseError, StrokeError):
            continue
        if best is None or mode.misfit.total < best[1].misfit.total:
            best = posterior, mode
        if best[1].chi2 < _ILL or of.name == NONE.name or (tried and best[1].misfit.total > hopeless):
            break
    return best


def _fine(
    stroke: FeltStroke, start: Start, noise: Noise, posterior: Posterior, mode: Mode, kept: Ints
) -> tuple[Posterior, Mode]:
    """Go on from the coarse mesh's mode with more frames on the fine one; as before where that fails."""
    more, now = _thinned(stroke, start.lump_mm, press=3, near=1, far=3)
    of = posterior.of
    other = Posterior(of, more, noise, FINE.hx_mm)
    z = other.start(
        mode.z[posterior.at["tissue"]], float(np.exp(posterior.one(mode.z, "ln_E"))), start.lump_mm
    )
    for name in ("tissue", *SINGLE, "gain", "offset"):
        z[other.at[name]] = mode.z[posterior.at[name]]
    force = np.log(np.maximum(posterior.stroke.rows_kPa.sum(1), 1.0))
    found = mode.z[posterior.at["force"]] - force
    z[other.at["force"]] = np.log(np.maximum(more.rows_kPa.sum(1), 1.0)) + np.interp(now, kept, found)
    known = dict(zip(kept[posterior.stroke.press :].tolist(), mode.z[posterior.at["place"]]))
    z[other.at["place"]] = [known.get(k, 0.0) for k in now[more.press :].tolist()]
    try:
        return other, search(other, forward_of(of, FINE, more), z, _FINE_STEPS, enough=1.0, damping=1e-4)
    except (CaseError, StrokeError):
        return posterior, mode


def _thinned(stroke: FeltStroke, lump_mm: float, press: int, near: int, far: int) -> tuple[FeltStroke, Ints]:
    """Every so-manieth frame, and their numbers: the lump is what the others are compared with."""
    p, n = stroke.press, len(stroke.place_mm) - stroke.press
    number = np.arange(n)
    close = np.abs(stroke.place_mm[p:] - lump_mm) < _NEAR_MM
    chosen = np.flatnonzero(np.where(close, number % near == 0, number % far == 0))
    pressed = np.arange(press - 1, p, press)
    return stroke.take(pressed, chosen), np.concatenate([pressed, p + chosen])
