"""How well strokes repeat, and whether two visits differ by more than that.

Repeatability is the spread of strokes over the same lump within one visit. What differs between visits
besides (zeroing, gain, force, place) is known where lumps were visited again without having changed
(`Between`). A change is beyond both where the confidence interval of the difference of the means leaves zero
out, with Student's t and Satterthwaite's degrees of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

from scipy import stats

CONFIDENCE = 0.95

QUANTITIES = {
    "d_mm": ("diameter", "mm"),
    "depth_mm": ("depth", "mm"),
    "t_mm": ("tissue thickness", "mm"),
    "F_N_per_m": ("force", "N/m"),
}
"""What two visits are compared by, in words and units."""

ASSUMES = (
    "95 % intervals of the change. They count how strokes of one visit differ among themselves, and take for "
    "granted that the probe was the same on both visits: a zero or gain that was calibrated anew in between, "
    "or has drifted, shifts all strokes of a visit together and is not in them."
)


ASSUMES_BETWEEN = (
    "95 % intervals of the change. They count how strokes of one visit differ among themselves, and how "
    "visits to lumps that had not changed differed in the data set: zeroing, gain, force, place."
)


@dataclass(frozen=True)
class Spread:
    """Mean and spread of `n` strokes. `repeatability` is the difference that two single strokes over the
    same lump stay within, 95 times of 100: 1.96 sqrt(2) sd (Bland and Altman 1986; ISO 5725-6)."""

    n: int
    mean: float
    sd: float | None
    low: float
    high: float
    repeatability: float | None


def spread(values: Sequence[float]) -> Spread | None:
    """Mean, standard deviation and range of the finite values; None if there is none."""
    finite = [v for v in values if math.isfinite(v)]
    if not finite:
        return None
    sd = stdev(finite) if len(finite) > 1 else None
    return Spread(
        n=len(finite),
        mean=fmean(finite),
        sd=sd,
        low=min(finite),
        high=max(finite),
        repeatability=None if sd is None else 1.96 * math.sqrt(2.0) * sd,
    )


@dataclass(frozen=True)
class Comparison:
    """Visit B against visit A. `beyond` is None where there are too few strokes to tell."""

    a: Spread
    b: Spread
    change: float
    change_low: float | None
    change_high: float | None
    beyond: bool | None
    text: str


@dataclass(frozen=True)
class Between:
    """What an estimate differs by from visit to visit, besides what its strokes do.

    Attributes
    ----------
    sd : float
        Standard deviation of the logarithm: .05 is 5 %.
    freedom : int
        How many visits it rests on, less the lumps visited.
    """

    sd: float
    freedom: int


def compare(
    a: Sequence[float],
    b: Sequence[float],
    *,
    what: str = "diameter",
    unit: str = "mm",
    between: Between | None = None,
) -> Comparison | None:
    """Is the change from `a` to `b` more than strokes, and visits, differ by themselves?

    Parameters
    ----------
    a, b : the values of the earlier and the later visit's strokes, in `unit`
    between : what visits differ by; None takes it for nothing

    Returns
    -------
    Comparison, or None if a visit has no number

    Examples
    --------
    >>> compare([10.0, 10.2, 9.9], [12.0, 12.3, 12.1]).beyond
    True
    >>> compare([10.0, 10.2, 9.9], [12.0, 12.3, 12.1], between=Between(0.1, 12)).beyond
    False
    """
    first, second = spread(a), spread(b)
    if first is None or second is None:
        return None
    change = second.mean - first.mean
    freedom = first.n + second.n - 2
    if freedom < 1 or min(first.n, second.n) < 2:
        text = (
            f"The {what} differs by {_signed(change)} {unit}. At least two strokes in each visit are needed "
            "to tell whether that means anything."
        )
        return Comparison(first, second, change, None, None, None, text)
    squares = (first.n - 1) * (first.sd or 0.0) ** 2 + (second.n - 1) * (second.sd or 0.0) ** 2
    parts = [(squares / freedom * (1 / first.n + 1 / second.n), freedom)]
    if between is not None:
        parts.append((between.sd**2 * (first.mean**2 + second.mean**2), between.freedom))
    half = _half(parts)
    low, high = change - half, change + half
    beyond = not low <= 0.0 <= high
    span = f"({_signed(low)} to {_signed(high)})"
    bound = "repeatability" if between is None else "what visits differ by"
    if beyond:
        way = "grew" if change > 0 else "shrank"
        text = f"The {what} {way} by {abs(change):.1f} {unit} {span}: beyond {bound}."
    else:
        text = f"The {what} differs by {_signed(change)} {unit} {span}: within {bound}."
    return Comparison(first, second, change, low, high, beyond, text)


def _half(parts: Sequence[tuple[float, int]]) -> float:
    """Half the interval from variances and their degrees of freedom (Satterthwaite 1946)."""
    variance = sum(v for v, _ in parts)
    spread = sum(v**2 / n for v, n in parts)
    freedom = variance**2 / spread if spread > 0 else parts[0][1]
    return float(stats.t.ppf(0.5 + CONFIDENCE / 2, freedom)) * math.sqrt(variance)


def _signed(value: float) -> str:
    return f"{value:+.1f}".replace("-", "\u2212")
