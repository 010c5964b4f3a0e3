"""How well strokes repeat, and whether two visits differ by more than that.

Repeatability is the spread of strokes over the same lump within one visit. A change between visits is "beyond
repeatability" when the confidence interval of the difference of the two means, from the pooled spread
within the visits and Student's t, leaves zero out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

from scipy import stats

CONFIDENCE = 0.95

ASSUMES = (
    "95 % intervals of the change. They count how strokes of one visit differ among themselves, "
    "and take for granted that the "
    "probe was the same on both visits: a zero or gain that was calibrated anew in between, or "
    "has drifted, shifts all strokes "
    "of a visit together and is not in them."
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


def compare(
    a: Sequence[float], b: Sequence[float], *, what: str = "diameter", unit: str = "mm"
) -> Comparison | None:
    """Is the change from `a` to `b` more than strokes differ among themselves? None if a visit has no number.

    Parameters
    ----------
    a, b : the values of the earlier and the later visit's strokes, in `unit`

    Examples
    --------
    >>> compare([10.0, 10.2, 9.9], [12.0, 12.3, 12.1]).beyond
    True
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
    error = math.sqrt(squares / freedom * (1 / first.n + 1 / second.n))
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, freedom)) * error
    low, high = change - half, change + half
    beyond = not low <= 0.0 <= high
    between = f"({_signed(low)} to {_signed(high)})"
    if beyond:
        way = "grew" if change > 0 else "shrank"
        text = f"The {what} {way} by {abs(change):.1f} {unit} {between}: beyond repeatability."
    else:
        text = f"The {what} differs by {_signed(change)} {unit} {between}: within repeatability."
    return Comparison(first, second, change, low, high, beyond, text)


def _signed(value: float) -> str:
    return f"{value:+.1f}".replace("-", "\u2212")
