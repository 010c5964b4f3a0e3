"""Numbers with their intervals, and what follows from several of them: depth in mm, stiffness as a factor.

An interval here is (value, low, high).
"""

from __future__ import annotations

from math import exp, hypot, log, sqrt

Span = tuple[float, float, float]

BORDER = 10.0
"""Times fat: what is stiffer is called hard."""
_WIDEST = log(1e6)
"""Half an interval's ln at most: what no model says a faulty probe may."""
BOUND_TO = 50.0
"""An upper bound of E beyond this is none: such lumps feel alike."""


def without_minus_zero(span: Span) -> Span:
    """The same to a thousandth, and none of it -0: a place may be as good as 0."""
    value, low, high = (round(v, 3) + 0.0 for v in span)
    return value, low, high


def depth_mm(t_mm: Span, d_mm: Span, h: Span) -> Span:
    """Fat over the lump, d h, with the interval that the model's three intervals imply.

    The thesis' t = d (h + 1/2) ties the three: ln(h + 1/2) = ln t - ln d, so the widths of t, d and h tell
    how the errors of t and d go together, and that they do is what makes the depth surer than two
    independent errors would. Where the three contradict the tie, as of an ellipsoid or where each was adapted
    on its own, the interval is wider by how far t - d/2 lies from d h.

    Parameters
    ----------
    t_mm, d_mm, h : value, low, high
        Of one estimate, at one level.

    Returns
    -------
    value, low, high
        mm, at the same level.
    """
    value, low, high = (max(d, 0.0) * max(ratio, 0.0) for d, ratio in zip(d_mm, h))
    if min(*t_mm, *d_mm, *h, value) <= 0.0:
        return value, low, high
    width_t, width_d, width_h = (log(high / low) / 2 for _, low, high in (t_mm, d_mm, h))
    width_ratio = width_h * h[0] / (h[0] + 0.5)
    together = (width_t**2 + width_d**2 - width_ratio**2) / 2
    together = min(max(together, -width_t * width_d), width_t * width_d)
    a, b = t_mm[0] / value, d_mm[0] / 2 / value
    width = sqrt(max((a * width_t) ** 2 + (b * width_d) ** 2 - 2 * a * b * together, 0.0))
    tied = max(t_mm[0] - d_mm[0] / 2, 0.5 * value)
    width = min(sqrt(width**2 + log(tied / value) ** 2), _WIDEST)
    return value, value * exp(-width), value * exp(width)


def stiffness(E_inv23: Span) -> tuple[float | None, float | None, float | None]:
    """E over fat from E^-2/3: value, low, high; None stands for no bound, for the physics saturates above E
    = 10."""

    def ratio(x: float) -> float | None:
        return x**-1.5 if x > 1e-3 else None

    value, low, high = E_inv23
    most = ratio(low)
    return ratio(value), ratio(high), None if most is None or most > BOUND_TO else most


def stiffness_kPa(E_inv23: Span, fat_kPa: Span) -> tuple[float | None, float | None, float | None]:
    """The lump's modulus, kPa: value, low, high; None stands for no bound.

    What is not sure of the fat widens the interval as an error of its own: widths add as squares.
    """
    factor, least, most = stiffness(E_inv23)
    fat, fat_low, fat_high = fat_kPa
    if factor is None:
        return None, None if least is None else least * fat_low, None
    value = factor * fat
    low = None if least is None else value * exp(-hypot(log(factor / least), log(fat / fat_low)))
    high = None if most is None else value * exp(hypot(log(most / factor), log(fat_high / fat)))
    return value, low, high
