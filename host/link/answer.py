"""What is worked out of an estimate's outputs for people: depth in mm, stiffness as a factor; one set of
words for command line, page, report and recordings.

An interval here is (value, low, high).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import exp, hypot, log, sqrt

from palpate.model_export.vocabulary import WORDS

Span = tuple[float, float, float]

BORDER = 10.0
"""Times fat: what is stiffer is called hard."""
BOUND_TO = 50.0
"""An upper bound of E beyond this is none: such lumps feel alike."""
LEAST_ODDS = 0.05
"""A place with less is not named among those that a lump may have."""

HARDNESS = {
    "hard": f"hard: {BORDER:g} times as stiff as fat, or more",
    "soft": f"soft: less than {BORDER:g} times as stiff as fat",
    "unsure": f"unsure: the interval lies on both sides of {BORDER:g} times fat, the border of hard",
}

WITHOUT_PRESS, UNFAMILIAR = "no_press", "unfamiliar"
_OUTSIDE = {
    "two_lumps": "there may be two lumps side by side",
    "uneven_tissue": "the tissue's thickness seems to rise and fall along the stroke",
    "softer": "the tissue seems softer than the model was told",
    "stiffer": "the tissue seems stiffer than the model was told",
    WITHOUT_PRESS: "the probe felt no press before the stroke, or too light a one",
    UNFAMILIAR: "no stroke that the model was fitted to was like it",
}


def outside_words(why: Sequence[str]) -> str:
    """Why a model is not for a stroke, as `palpate.across.outside` finds it; "" if nothing is known."""
    beyond = [WORDS[name] for name in why if name in WORDS]
    other = [name.replace("_", " ") for name in why if name not in _OUTSIDE and name not in WORDS]
    told = [f"{' and '.join(beyond)} would lie beyond what the model knows"] if beyond else []
    told += [_OUTSIDE[name] for name in why if name in _OUTSIDE]
    if other:
        told.append(f"it looks like {' or '.join(other)}")
    return "; ".join(told)


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
    width = sqrt(width**2 + log(tied / value) ** 2)
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


def stiffness_words(E_inv23: Span, fat_kPa: Span | None = None) -> str:
    """The interval as a factor, `over 14 × fat` or `3.1 to 12 × fat`; in kPa too where the fat is known."""
    words = f"{_between(stiffness(E_inv23), 1.0)} × fat"
    if fat_kPa is not None:
        words += f", {_between(stiffness_kPa(E_inv23, fat_kPa), fat_kPa[0])} kPa"
    return words


def place_words(place: str, odds: Mapping[str, float]) -> str:
    """Where a lump lies, as `in the fat (93 %)`; where that is not sure, what it may be."""
    chances = [f"{where} {100 * of:.0f} %" for where, of in odds.items() if of >= LEAST_ODDS]
    return f"{place} ({100 * odds[place]:.0f} %)" if place in odds else f"{place}: {', '.join(chances)}"


def size_words(sizes: Sequence[tuple[float | None, float]], within: float) -> str:
    """Which diameter goes with which stiffness: `13.4 mm if 3.1 × fat, 10.1 mm if 12 × fat (each ± 7 %)`.

    sizes: pairs of a stiffness, times fat (None: too stiff to tell), and a diameter, mm; within: each is
    known to that share.
    """
    pairs = [f"{d:.1f} mm if {_stiff(E)} × fat" for E, d in sizes]
    return f"{', '.join(pairs)} (each ± {100 * within:.0f} %)"


def _stiff(E: float | None) -> str:
    return f"over {BOUND_TO:.0f}" if E is None else _short(E)


def _between(span: tuple[float | None, float | None, float | None], least: float) -> str:
    _, low, high = span
    low = least if low is None else low
    return f"over {_short(low)}" if high is None else f"{_short(low)} to {_short(high)}"


def _short(number: float) -> str:
    return f"{number:.0f}" if number >= 10 else f"{number:.2g}"
