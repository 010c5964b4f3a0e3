"""Sums of products in integers: a coefficient as a high and a low word."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.fixedpoint.errors import ProofError

ROOM = 1.06e9  # below 2^30: the proof's intervals are a little wider than the sums here
MOST_COARSE = 2000  # of a word that has no other beside it

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass
class Row:
    """One sum: coefficients over its inputs (each within +-1), intercept, fraction bits of the result."""

    coefficients: Floats
    intercept: float
    fraction: int
    name: str


@dataclass(frozen=True)
class Words:
    """A row in integers: high and low words, intercept, shift of its sum, fraction bits of the high words."""

    high: Integers
    low: Integers
    intercept: int
    shift: int
    fraction: int


def to_word(value: float, name: str) -> int:
    """Nearest integer; ProofError if it is beyond the firmware's integers."""
    number = round(value)
    if abs(number) >= 1 << 30:
        raise ProofError(f"{name} does not fit the firmware's integers: {value:g} is beyond 2^30")
    return number


def split(whole: Integers, low: int) -> tuple[Integers, Integers]:
    """High words, and what is left in low words of `low` bits."""
    high = (whole + (1 << low - 1)) >> low
    return high, whole - (high << low)


def places_for(row: Row, bits: int, most: int) -> int:
    """Places of words that meet `bits` of their inputs in one sum: as many as there is room for."""
    sizes = np.abs(row.coefficients)
    for places in range(30, -30, -1):
        scaled = sizes * 2.0**places
        if np.max(scaled, initial=0.0) <= most and (scaled.sum() + len(sizes)) * 1.001 * 2.0**bits < ROOM:
            return places
    raise ProofError(f"the coefficients of {row.name} are too large for the firmware's integers")


def places_within(row: Row, part: int, high: int, low: int, tolerance: float) -> int:
    """The fewest places with which a row's error, at about its worst, is within `tolerance`.

    Where there is no room for so many, all for which there is room. As long as the coefficients fit low words
    there are no high ones.

    Parameters
    ----------
    part, high, low : bits of an input that high and low words meet, and of a low word
    """
    largest = np.abs(row.coefficients).max(initial=1e-9) * 1.002 * 2.0**part
    finest = low + int(np.floor(np.log2(ROOM / largest)))
    places = min(places_for(row, high, (1 << low - 1) - 1), finest)
    while places < finest:
        first, second = split(np.round(row.coefficients * 2.0**places).astype(np.int64), low)
        inputs = np.linalg.norm(first) * 2.0 ** (low - part) + np.linalg.norm(second) * 2.0**-high
        if (0.4 * np.sqrt(len(first)) + 0.7 * inputs) * 2.0**-places < tolerance:
            break
        places += 1
    return places


def coarse(row: Row, bits: int) -> Words:
    """A row of high words alone, for inputs of so many bits."""
    fraction = places_for(row, bits, MOST_COARSE)
    high = np.round(row.coefficients * 2.0**fraction).astype(np.int64)
    intercept = to_word(row.intercept * 2.0**row.fraction, f"the intercept of {row.name}")
    return Words(high, np.zeros_like(high), intercept, fraction + bits - row.fraction, fraction)
