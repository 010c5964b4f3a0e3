"""An estimate in words: one set of them for command line, page, report and recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from palpate.model_export.vocabulary import WORDS
from palpate.spans import BORDER, BOUND_TO, Span, stiffness, stiffness_kPa

LEAST_ODDS = 0.05
"""A place with less is not named among those that a lump may have."""

HARDNESS = {
    "hard": f"hard: {BORDER:g} times as stiff as fat, or more",
    "soft": f"soft: less than {BORDER:g} times as stiff as fat",
    "unsure": f"unsure: the interval holds {BORDER:g} times fat, the border of hard",
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
    """Why a model is not for a stroke, as `palpate.answer.outside` finds it; "" if nothing is known."""
    beyond = [WORDS[name] for name in why if name in WORDS]
    other = [name.replace("_", " ") for name in why if name not in _OUTSIDE and name not in WORDS]
    told = [f"{' and '.join(beyond)} would lie beyond what the model knows"] if beyond else []
    told += [_OUTSIDE[name] for name in why if name in _OUTSIDE]
    if other:
        told.append(f"it looks like {' or '.join(other)}")
    return "; ".join(told)


def stiffness_words(E_inv23: Span, fat_kPa: Span | None = None) -> str:
    """As a factor, `over 14 × fat` or `6.1 (3.1 to 12) × fat`; in kPa too where the fat is known."""
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
    value, low, high = span
    low = least if low is None else low
    if high is None or value is None:
        return f"over {_short(low)}"
    return f"{_short(value)} ({_short(low)} to {_short(high)})"


def _short(number: float) -> str:
    return f"{number:.0f}" if number >= 10 else f"{number:.2g}"
