"""What may be believed, in words, and how many more lumps would settle the rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate.dataset.agreement import FEWEST, Agreement, Estimated, Z

BIAS = 0.03
"""A bias up to this is none that matters; of E^-2/3 as of the others' logarithms."""
COVERAGE = 0.03
"""Intervals that hold the truth this much less, or more, often than they say are still right."""


@dataclass(frozen=True)
class Verdict:
    """One output's.

    Attributes
    ----------
    believed : bool or None
        Whether value and interval may be taken as they are; None: the data do not settle it.
    text : str
    more_lumps : int
        How many more lumps like these would settle what is open; 0 where nothing is.
    """

    believed: bool | None
    text: str
    more_lumps: int


def verdict(found: Agreement, level: float) -> Verdict:
    """The verdict on an output whose intervals claim the coverage `level`."""
    if found.lumps < FEWEST:
        return Verdict(None, f"{found.lumps} lumps are too few to say anything.", FEWEST - found.lumps)
    bias, bias_words = _bias(found)
    covers, cover_words = _coverage(found.coverage, level)
    parts = [bias_words, cover_words]
    more = 0
    if None in (bias, covers) and False not in (bias, covers):
        more = max(_wanted(found, level) - found.lumps, 1)
        parts.append(f"About {more} more lumps would settle it.")
    low, high = (percent(e.value, found.absolute) for e in found.limits)
    parts.append(f"A single stroke is off by {low} to {high}, 95 times in 100.")
    believed = None if None in (bias, covers) else True
    return Verdict(False if False in (bias, covers) else believed, " ".join(parts), more)


def percent(error: float, absolute: bool) -> str:
    """An error as people read it: +4 %, or +0.040 where it is a difference."""
    if absolute:
        return f"{error:+.3f}"
    return f"{100 * math.expm1(error):+.1f} %"


def _bias(found: Agreement) -> tuple[bool | None, str]:
    b = found.bias
    if b.low is None or b.high is None:
        return None, "Its bias is open."
    middle, low, high = (percent(v, found.absolute) for v in (b.value, b.low, b.high))
    span = f"{middle} ({low} to {high})"
    if b.low >= -BIAS and b.high <= BIAS:
        return True, f"No bias that matters: {span}."
    if b.low > BIAS or b.high < -BIAS:
        return False, f"It reads too {'large' if b.value > 0 else 'small'}: {span}."
    return None, f"Its bias is not settled: {span}."


def _coverage(c: Estimated, level: float) -> tuple[bool | None, str]:
    if c.low is None or c.high is None:
        return None, "Whether its intervals hold is open."
    span = f"{100 * c.value:.0f} % of the truths, 95 % interval {100 * c.low:.0f} to {100 * c.high:.0f}"
    meant = f"where {100 * level:.0f} % are meant"
    if c.high < level - COVERAGE:
        return False, f"Its intervals are too narrow: they hold {span}, {meant}."
    if c.low > level + COVERAGE:
        return True, f"Its intervals are wider than they need be: they hold {span}, {meant}."
    if c.low >= level - COVERAGE:
        return True, f"Its intervals are right: they hold {span}, {meant}."
    return None, f"Whether its intervals hold is not settled: they hold {span}, {meant}."


def _wanted(found: Agreement, level: float) -> int:
    """Lumps from which both confidence intervals are as wide as what they are held against."""
    strokes = found.strokes / found.lumps
    spread = math.hypot(found.sd_lump, found.sd_stroke / math.sqrt(strokes))
    c = found.coverage
    of_coverage = math.sqrt(level * (1 - level))
    if c.low is not None and c.high is not None:
        seen = (c.high - c.low) / (2 * Z) * math.sqrt(found.lumps)
        of_coverage = max(seen, of_coverage / math.sqrt(strokes))
    return math.ceil(max((Z * spread / BIAS) ** 2, (Z * of_coverage / COVERAGE) ** 2))
