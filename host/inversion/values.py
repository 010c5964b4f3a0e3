"""The numbers of a mode: how each spreads on its own scale, and as values with intervals.

Lengths, forces and moduli are logarithms, E^-2/3 and what lies between two lumps (mm) themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from palpate.answer.fitted import Value
from palpate.inversion.classes import APART, DEEPER, LARGER
from palpate.inversion.posterior import Posterior
from palpate.inversion.search import Mode
from palpate.inversion.solid_classes import HEIGHT, WIDTH
from palpate.inversion.valley import TAILS, Spread, sum_of
from palpate.inversion.widening import NORMAL, WIDER, Widening

Floats = NDArray[np.float64]
Spreads = dict[str, Spread]
"""By the name of the value: its middle, and half an interval to either side."""

_PLAIN = ("E_inv23", "apart_mm")
_FINE = 2001


def spreads_of(posterior: Posterior, mode: Mode, wider: Mapping[str, Widening] = WIDER) -> Spreads:
    """Of everything that a mode tells; wider: by unknown."""
    names = [unknown.name for unknown in posterior.of.unknowns]
    z = mode.z
    case = posterior.of.case(z[: len(names)])
    fat, force = posterior.at["ln_E"].start, posterior.force_at(z)
    common = posterior.noise.common_gain

    def weighted(weights: Mapping[str | int, float]) -> Floats:
        """By name or number of the unknown."""
        w = np.zeros(len(z))
        for key, weight in weights.items():
            w[names.index(key) if isinstance(key, str) else key] += weight
        return w

    def widened(of: Spread, like: str, more: float = 0.0) -> Spread:
        """As one of the unknowns is."""
        halves = (wider[like].half(float(np.hypot(sd, more)), mode.settled) for sd in (of.below, of.above))
        return Spread(of.middle, *halves)

    def spread(at: float, weights: dict[str | int, float], like: str, more: float = 0.0) -> Spread:
        """Of a sum of unknowns which is `at` at the mode."""
        w = weighted(weights)
        of, sds = mode.spread(sum_of(w)), mode.sides.get(like)
        if sds is not None and set(weights) == alone.get(like):
            of = of._replace(below=sds.below, above=sds.above)
        return widened(of._replace(middle=at + of.middle - float(w @ z)), like, more)

    def log(value: float, weights: dict[str | int, float], like: str, more: float = 0.0) -> Spread:
        return spread(float(np.log(value)), weights, like, more)

    E = float(np.exp(z[fat]))
    alone: dict[str, set[str | int]] = {"ln_E": {fat}, **{name: {name} for name in names}}
    height: dict[str | int, float] = {"ln d": 1.0, **({HEIGHT: 1.0} if HEIGHT in names else {})}

    def thick(z: Floats) -> tuple[float, Floats]:
        """ln t where the lump is on the border: depth and half the height."""
        over, down = weighted({"ln depth": 1.0}), weighted(height)
        depth, half = np.exp(over @ z), np.exp(down @ z) / 2
        t = depth + half
        return float(np.log(t)), (depth * over + half * down) / t

    out = {
        "F_N_per_m": log(E * float(np.exp(z[force])), {fat: 1.0, force: 1.0}, "ln_E", common),
        "t_mm": log(case.t_mm, {"ln t": 1.0}, "ln t")
        if "ln t" in names
        else widened(mode.spread(thick), "ln t"),
        "E_fat_kPa": log(E, {fat: 1.0}, "ln_E", common),
        "gland_mm": log(case.gland_mm, {"ln gland": 1.0}, "ln t"),
        "gland_ratio": log(case.gland_ratio, {"ln gland ratio": 1.0}, "ln t"),
    }
    if "ln d" in names:
        out |= {
            "d_mm": log(case.d_mm, {"ln d": 1.0}, "ln d"),
            "h": log(case.h, {"ln depth": 1.0, "ln d": -1.0}, "ln d"),
            "depth_mm": log(case.depth_mm, {"ln depth": 1.0}, "ln depth"),
            "E_inv23": spread(case.E_inv23, {"E^-2/3": 1.0}, "E^-2/3"),
        }
    if case.solid and case.has_lump:
        across: dict[str | int, float] = {"ln d": 1.0, **({WIDTH: 1.0} if WIDTH in names else {})}
        out["width_mm"] = log(2 * case.half_axes_mm[1], across, "ln width")
    if LARGER in names:
        d2, depth2 = (
            case.d_mm * np.exp(z[names.index(LARGER)]),
            case.depth_mm * np.exp(z[names.index(DEEPER)]),
        )
        out |= {
            "d2_mm": log(d2, {"ln d": 1.0, LARGER: 1.0}, "ln d"),
            "depth2_mm": log(depth2, {"ln depth": 1.0, DEEPER: 1.0}, "ln depth"),
            "apart_mm": spread(z[names.index(APART)], {APART: 1.0}, "apart"),
        }
    return out


def values_of(spreads: Spreads) -> dict[str, Value]:
    """Values with their intervals; from E^-2/3 and the fat's modulus those of E follow."""
    out: dict[str, Value] = {}
    for name, (middle, below, above) in spreads.items():
        ends = middle, middle - below, middle + above
        out[name] = Value(*(ends if name in _PLAIN else np.exp(ends).tolist()))
        if name == "E_inv23":
            s = out[name] = replace(out[name], low=max(ends[1], 0.0))
            ratio = Value(s.value**-1.5, ends[2] ** -1.5, ends[1] ** -1.5 if ends[1] > 0 else None)
            E = out["E_fat_kPa"].value
            out["E_ratio"] = ratio
            out["E_kPa"] = Value(*(v and v * E for v in (ratio.value, ratio.low, ratio.high)))  # type: ignore[arg-type]
    return out


def mixed(each: Sequence[Spreads], shares: Floats) -> Spreads:
    """Of several modes together, each of them a share: medians, and intervals of the mixture."""
    weights = shares / shares.sum()
    out = {}
    for name in each[0]:
        middle, below, above = np.array([of[name] for of in each]).T[:, :, None]
        x = np.linspace((middle - 3 * below).min(), (middle + 3 * above).max(), _FINE)
        sd = np.maximum(np.where(x < middle, below, above) / NORMAL, 1e-9)
        low, half_way, high = np.interp(TAILS, weights @ norm.cdf((x - middle) / sd), x)
        out[name] = Spread(float(half_way), float(half_way - low), float(high - half_way))
    return out
