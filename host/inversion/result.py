"""What an inversion says of a stroke. Units in the names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.answer.fitted import Inverted, Value
from palpate.inversion.classes import APART, DEEPER, LARGER
from palpate.inversion.departures import DEPARTURES, FRICTION, TWO_LUMPS, UNDULATING
from palpate.inversion.found import Ends
from palpate.inversion.joint import Together
from palpate.inversion.posterior import Posterior
from palpate.inversion.search import Mode, Sides
from palpate.inversion.solid_classes import HEIGHT, WIDTH
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
    names = [unknown.name for unknown in posterior.of.unknowns]
    z, C = mode.z, mode.covariance
    case = posterior.of.case(z[: len(names)])
    fat = posterior.at["ln_E"].start
    force = posterior.force_at(z)
    common = posterior.noise.common_gain

    def half(weights: dict[str | int, float], like: str, more: float = 0.0) -> Sides:
        """Half-widths for a sum of unknowns, by name or number, widened as one of them is."""
        w = np.zeros(len(z))
        for key, weight in weights.items():
            w[names.index(key) if isinstance(key, str) else key] += weight
        laplace = float(np.sqrt(w @ C @ w))
        sds = mode.sides.get(like) if set(weights) == alone.get(like) else None
        each = sds or Sides(laplace, laplace)
        return Sides(*(wider[like].half(float(np.hypot(sd, more)), mode.settled) for sd in each))

    def log(value: float, by: Sides) -> Value:
        return Value(value, value * float(np.exp(-by.below)), value * float(np.exp(by.above)))

    E = float(np.exp(z[fat]))
    alone: dict[str, set[str | int]] = {"ln_E": {fat}, **{name: {name} for name in names}}
    thick: dict[str | int, float] = {"ln t": 1.0}
    if "ln t" not in names:  # on the border it is depth + d/2
        down = case.half_down / case.t_mm
        thick = {"ln depth": case.depth_mm / case.t_mm, "ln d": down}
        if HEIGHT in names:
            thick[HEIGHT] = down
    values = {
        "F_N_per_m": log(E * float(np.exp(z[force])), half({fat: 1.0, force: 1.0}, "ln_E", common)),
        "t_mm": log(case.t_mm, half(thick, "ln t")),
        "E_fat_kPa": log(E, half({fat: 1.0}, "ln_E", common)),
        "gland_mm": log(case.gland_mm, half({"ln gland": 1.0}, "ln t")),
        "gland_ratio": log(case.gland_ratio, half({"ln gland ratio": 1.0}, "ln t")),
    }
    centre = None
    if "ln d" in names:
        d = half({"ln d": 1.0}, "ln d")
        s, ds = case.E_inv23, half({"E^-2/3": 1.0}, "E^-2/3")
        low, high = max(s - ds.below, 0.0), s + ds.above
        ratio = Value(case.E_ratio, high**-1.5, low**-1.5 if low > 0 else None)
        values |= {
            "d_mm": log(case.d_mm, d),
            "h": log(case.h, half({"ln depth": 1.0, "ln d": -1.0}, "ln d")),
            "depth_mm": log(case.depth_mm, half({"ln depth": 1.0}, "ln depth")),
            "E_inv23": Value(s, low, high),
            "E_ratio": ratio,
            "E_kPa": Value(*(None if v is None else v * E for v in (ratio.value, ratio.low, ratio.high))),  # type: ignore[arg-type]
        }
        centre = posterior.one(z, "start")
    if case.solid and case.has_lump:
        across: dict[str | int, float] = {"ln d": 1.0, **({WIDTH: 1.0} if WIDTH in names else {})}
        values["width_mm"] = log(2 * case.half_axes_mm[1], half(across, "ln width"))
    if LARGER in names:
        values |= {
            "d2_mm": log(
                case.d_mm * np.exp(z[names.index(LARGER)]), half({"ln d": 1.0, LARGER: 1.0}, "ln d")
            ),
            "depth2_mm": log(
                case.depth_mm * np.exp(z[names.index(DEEPER)]),
                half({"ln depth": 1.0, DEEPER: 1.0}, "ln depth"),
            ),
        }
        apart, more = z[names.index(APART)], half({APART: 1.0}, "apart")
        values["apart_mm"] = Value(apart, apart - more.below, apart + more.above)
    other = max((name for name in DEPARTURES if name != posterior.of.name), key=lambda it: odds.get(it, 0.0))
    why = ""
    if odds.get(other, 0.0) > SURE:
        why = f"{_DEPARTED[other]} would explain it better (odds {odds[other]:.0%})"
    elif mode.chi2 >= FITS:
        why = "no class of tissue and lump explains it"
    layers = _layers(names, z, C) if "ln d" in names else {}
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
    index = posterior.index[0]
    own = replace(mode, z=mode.z[index], covariance=mode.covariance[np.ix_(index, index)])
    said = told(posterior.parts[0], own, odds, posterior.places(mode.z), wider)
    strokes = len(posterior.parts)
    return said if strokes == 1 else replace(said, together=strokes, centre_mm=None)


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
