"""What a search has found, and what a posterior of several strokes is assembled from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.forward import Predicts
from palpate.inversion.joint import Together
from palpate.inversion.posterior import Posterior
from palpate.inversion.search import Mode
from palpate.inversion.under import emulated_of, forward_of
from palpate.sim.tissue import Settings

Ints = NDArray[np.int64]

_SAME = 4.0
"""Modes nearer than so many standard deviations are one."""


@dataclass(frozen=True)
class Found:
    """A class's mode on one mesh, or by the emulator.

    Attributes
    ----------
    kept : list of ndarray
        The frames of each stroke that were used.
    """

    posterior: Together
    forward: Predicts
    mode: Mode
    kept: list[Ints]


class Ends(Protocol):
    """A search of a class that has come to a mode."""

    @property
    def posterior(self) -> Together: ...

    @property
    def mode(self) -> Mode: ...


End = TypeVar("End", bound=Ends)


def distinct(modes: Sequence[End], by: Callable[[End], float]) -> list[End]:
    """In this order, without modes that lie within an earlier one's posterior.

    A wide mode may run through a narrow one, where a stroke tells little of the layers; it stays.
    """
    out: list[End] = []
    for one in sorted(modes, key=by):
        if all(_away(one, other) > _SAME for other in out):
            out.append(one)
    return out


def _away(one: Ends, other: Ends) -> float:
    """How far a mode is from another one of its class, in the other's standard deviations."""
    at = other.posterior.at["tissue"]
    apart = one.mode.z[at] - other.mode.z[at]
    return float(np.sqrt(apart @ np.linalg.solve(other.mode.covariance[at, at], apart)))


Assemble = Callable[[Sequence[Posterior], Settings | None], tuple[Together, Predicts]]
"""Makes one posterior of several strokes', and what predicts their frames: emulated, without settings."""


def one_lump(parts: Sequence[Posterior], settings: Settings | None) -> tuple[Together, Predicts]:
    """Of strokes over one lump."""
    of, strokes = parts[0].of, [part.stroke for part in parts]
    both = Together(parts)
    return (both, emulated_of(of, strokes)) if settings is None else (both, forward_of(of, settings, strokes))
