"""What else the stroke may be over: two lumps, undulating tissue, a face that rubs; to first order.

Each departure adds columns X, with weights w of known spread, to what a mode predicts. With residuals r and
their Jacobian A at the mode, all of it linear, the evidence of the departure over the mode's own class is

    ln Z' / Z = b^T (S + D^-2)^-1 b / 2 - ln det(1 + D S D) / 2,    b = X^T r,    S = X^T (1 - A H^-1 A^T) X

with D the spreads of w and H = A^T A + B^T B. It tells which departure explains what is left, not its size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from palpate.inversion.forward import Predicts, Rubs
from palpate.inversion.joint import Together
from palpate.inversion.search import Mode

Floats = NDArray[np.float64]

TWO_LUMPS, UNDULATING, FRICTION = "two lumps", "undulating", "friction"
DEPARTURES = (TWO_LUMPS, UNDULATING, FRICTION)
RARE = float(np.log(0.02))
"""How likely each is beforehand, over the class that it departs from, as a logarithm."""

_APART_MM = np.concatenate([-np.arange(6.0, 31.0, 2.0), np.arange(6.0, 31.0, 2.0)])
_SECOND = 0.7
_WAVES_MM = (25.0, 40.0, 60.0, 90.0)
_SWING = 0.03
_RUBS = 0.15
_DEPARTS_FROM = 1.1
"""Waves of 5 % leave misfits of 1.8 and more, friction of .2 of 1.8: where it is no larger neither matters,
and what the mesh gets wrong over hard lumps under the skin looks like a wave."""

_PLAIN = 4
"""So many frames, the farthest from the lump, are over plain tissue."""


@dataclass(frozen=True)
class _Columns:
    """What a departure adds to the weighted residuals, (n (rows + 1), m), and the spread of its weights."""

    X: Floats
    spread: float


def odds_of_departures(posterior: Together, mode: Mode, forward: Predicts) -> dict[str, float]:
    """How likely each departure is over the class of the mode, as logarithms, by name."""
    said: dict[str, list[float]] = {}
    for name, columns in _departures(posterior, mode, forward):
        said.setdefault(name, []).append(_evidence(mode, columns))
    return {name: RARE + float(logsumexp(some)) - np.log(len(some)) for name, some in said.items()}


def _evidence(mode: Mode, columns: _Columns) -> float:
    X, A = columns.X * columns.spread, mode.jacobian
    across = A.T @ X
    S = X.T @ X - across.T @ mode.covariance @ across
    b = X.T @ mode.misfit.data.ravel()
    M = np.eye(X.shape[1]) + S
    return 0.5 * float(b @ np.linalg.solve(M, b)) - 0.5 * float(np.linalg.slogdet(M)[1])


def _departures(posterior: Together, mode: Mode, forward: Predicts) -> Iterator[tuple[str, _Columns]]:
    if posterior.of.lump:
        for apart in _APART_MM:
            yield TWO_LUMPS, _columns(posterior, mode, [_second(mode, apart)], _SECOND)
    if mode.chi2 < _DEPARTS_FROM:
        return
    found, slopes = mode.found, mode.slopes
    place = found.places_mm
    by_force = np.concatenate([slopes.images[:, :, -1], slopes.depth[:, None, -1]], 1)
    felt = np.concatenate([found.images, np.zeros((len(place), 1))], 1)
    softer = felt - by_force  # stiffer tissue is pressed less, and its pressures are those of less force
    waves = [wave(2 * np.pi * place / length) for length in _WAVES_MM for wave in (np.sin, np.cos)]
    yield UNDULATING, _columns(posterior, mode, [wave[:, None] * softer for wave in waves], _SWING)
    if isinstance(forward, Rubs):
        yield FRICTION, _columns(posterior, mode, [forward.by_friction(found)], _RUBS)


def _second(mode: Mode, apart_mm: float) -> Floats:
    """What a second lump of its kind, so far from the first, would add to images and depth, (n, rows + 1)."""
    found = mode.found
    force = found.forces_N_per_m[:, None]
    felt = np.concatenate([found.images / force, found.depth[:, None]], 1)
    order = np.argsort(found.places_mm, kind="stable")
    plain = felt[np.argsort(-np.abs(found.places_mm))[:_PLAIN]].mean(0)
    there = [
        np.interp(found.places_mm - apart_mm, found.places_mm[order], column[order]) for column in felt.T
    ]
    more = np.column_stack(there) - plain
    more[:, :-1] *= force
    return more


def _columns(posterior: Together, mode: Mode, changes: list[Floats], spread: float) -> _Columns:
    """Changes (n, rows + 1) of computed images and displacement, as weighted residuals."""
    seen = [posterior.seen(mode.z, change).ravel() for change in changes]
    return _Columns(np.column_stack(seen), spread)
