"""What an inversion says of a stroke. Units in the names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.answer.fitted import Inverted, Value
from palpate.inversion.departures import DEPARTURES, FRICTION, TWO_LUMPS, UNDULATING
from palpate.inversion.found import Ends
from palpate.inversion.joint import Together
from palpate.inversion.posterior import Posterior
from palpate.inversion.search import Mode
from palpate.inversion.values import mixed, spreads_of, values_of
from palpate.inversion.widening import WIDER, Widening

Floats = NDArray[np.float64]


FITS = 1.3
"""A misfit below this, for each degree of freedom, fits: computed strokes have 0.6 to 1.1."""
SURE = 0.9
_SAMPLES = 4000
_DEPARTED = {
    TWO_LUMPS: "a second lump beside the first",
    UNDULATING: "tissue that undulates along the stroke",
    FRICTION: "friction between face and skin",
}


def told(
    posterior: Posterior,
    mode: Mode,
    odds: dict[str, float],
    places_mm: Floats | None = None,
    wider: Mapping[str, Widening] = WIDER,
) -> Inverted:
    """The values and intervals of a mode.

    Parameters
    ----------
    places_mm : ndarray (n,), optional
        Of the misfit's frames, if of more than its own.
    wider : mapping of Widening
        By unknown.
    """
    names, z = [unknown.name for unknown in posterior.of.unknowns], mode.z
    values = values_of(spreads_of(posterior, mode, wider))
    centre = posterior.one(z, "start") if "ln d" in names else None
    other = max((name for name in DEPARTURES if name != posterior.of.name), key=lambda it: odds.get(it, 0.0))
    why = ""
    if odds.get(other, 0.0) > SURE:
        why = f"{_DEPARTED[other]} would explain it better (odds {odds[other]:.0%})"
    elif mode.chi2 >= FITS:
        why = "no class of tissue and lump explains it"
    layers = _layers(names, z, mode.covariance) if "ln d" in names else {}
    worst = worst_part(
        posterior.by_row(mode.misfit.data), posterior.places(z) if places_mm is None else places_mm
    )
    return Inverted(
        posterior.stroke.stroke, values, posterior.of.name, odds, mode.chi2, not why, mode.settled, worst,
        centre, why, layers, press=posterior.stroke.alone,
    )  # fmt: skip


def told_together(
    posterior: Together, mode: Mode, odds: dict[str, float], wider: Mapping[str, Widening] = WIDER
) -> Inverted:
    """What a mode over several strokes says, by the first of them; as `told`."""
    said = told(posterior.parts[0], _own(posterior, mode), odds, posterior.places(mode.z), wider)
    strokes = len(posterior.parts)
    return said if strokes == 1 else replace(said, together=strokes, centre_mm=None)


def _own(posterior: Together, mode: Mode) -> Mode:
    """By the first stroke's unknowns."""
    return mode.own(np.eye(len(mode.z))[posterior.index[0]])


def told_of_classes(
    modes: Sequence[Ends], odds: dict[str, float], wider: Mapping[str, Widening] = WIDER
) -> Inverted:
    """What the likeliest modes of several classes say together: middles and intervals of all of them, each by
    the share that its whole valley has; else as the first of them says."""
    first = modes[0]
    shares = np.exp([one.mode.whole_evidence - first.mode.whole_evidence for one in modes])
    spreads = [spreads_of(one.posterior.parts[0], _own(one.posterior, one.mode), wider) for one in modes]
    said = told_together(first.posterior, first.mode, odds, wider)
    return replace(said, values=values_of(mixed(spreads, shares)))


def told_of_modes(
    modes: Sequence[Ends], odds: dict[str, float], wider: Mapping[str, Widening] = WIDER
) -> Inverted:
    """What modes over several strokes say together, as `told_together` and `of_modes`."""
    return of_modes(
        [told_together(one.posterior, one.mode, odds, wider) for one in modes],
        [one.mode.log_evidence for one in modes],
    )


def of_modes(said: Sequence[Inverted], log_evidence: Sequence[float]) -> Inverted:
    """What modes say together: the first one's values, intervals that hold every one's, layers by odds."""
    first = said[0]
    values = {}
    for name, value in first.values.items():
        lows, highs = ([getattr(one.values[name], end) for one in said] for end in ("low", "high"))
        low, high = None if None in lows else min(lows), None if None in highs else max(highs)
        values[name] = Value(value.value, low, high)
    share = np.exp(np.array(log_evidence) - max(log_evidence))
    share /= share.sum()
    layers = {
        name: float(sum(p * one.layers.get(name, 0.0) for p, one in zip(share, said)))
        for name in first.layers
    }
    return replace(first, values=values, layers=layers)


def _layers(names: list[str], z: Floats, C: Floats) -> dict[str, float]:
    """How likely the lump lies in the fat alone, across its border, in the gland alone, by samples."""
    k = [names.index(name) for name in ("ln d", "ln depth", "ln t") if name in names]
    if len(k) < 3:
        return {}
    some = np.random.default_rng(0).multivariate_normal(z[k], C[np.ix_(k, k)], _SAMPLES)
    d, depth, t = np.exp(some).T
    fat, gland = float((depth + d <= t).mean()), float((depth >= t).mean())
    return {"fat": fat, "border": 1 - fat - gland, "gland": gland}


def worst_part(data: Floats, places_mm: Floats) -> str:
    """Which row, frame or sensor the misfit (n, rows + 1) is greatest in, for its share of the data."""
    squares = data**2
    by_row, by_frame = squares.mean(0), squares.mean(1)
    row, frame = int(by_row[:-1].argmax()), int(by_frame.argmax())
    candidates = [
        (by_row[-1], "the displacement"),
        (by_row[row], f"row {row}"),
        (by_frame[frame], f"the frame {places_mm[frame]:+.0f} mm from the lump"),
    ]
    value, words = max(candidates)
    return f"{words} (misfit {value:.1f})"
