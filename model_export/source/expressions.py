"""Pieces of straight-line Python, as text: sums of products, shifts, clips, the exponential."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from palpate.model_export.schema import Term

_WIDE = 118  # columns


def product(term: Term, names: tuple[str, ...]) -> str:
    """A term in words."""
    return " * ".join(names[i] for i in term)


def shifted(text: str, by: int) -> str:
    """`text` over 2^by."""
    if by == 0:
        return text
    return f"({text} >> {by})" if by > 0 else f"({text} << {-by})"


def clipped(name: str, lo: int, hi: int) -> str:
    """An expression: the variable `name`, held between `lo` and `hi`."""
    return f"{lo} if {name} < {lo} else {hi} if {name} > {hi} else {name}"


def wrapped(words: list[str], indent: str) -> list[str]:
    """Words in lines that are not too long."""
    lines = [indent + words[0]]
    for word in words[1:]:
        if len(lines[-1]) + 1 + len(word) > _WIDE:
            lines.append(indent + word)
        else:
            lines[-1] += " " + word
    return lines


def terms(coefficients: Iterable[int], names: Iterable[str]) -> list[str]:
    """The sum of products as words, each with its sign in front; none that is nothing."""
    words: list[str] = []
    for c, name in zip(coefficients, names, strict=True):
        if c:
            sign = "-" if c < 0 else "+" if words else ""
            words.append(f"{sign} {abs(c)} * {name}".strip() if words else f"{c} * {name}")
    return words or ["0"]


def exponential(what: str, s: int, target: str) -> Iterator[str]:
    """`scales.exp`, whose ends no prediction and no width can reach."""
    yield f"    w = {what}; k = w // 181704; w -= k * 181704 + (k * 3 >> 3); m = powers[k & 63]; h = w >> 3"
    yield f"    w += h * h >> 19; m += (m >> 10) * (w >> 3) >> 11; k = {s} - (k >> 6)"
    yield f"    {target} = m + (1 << k - 1) >> k if k > 0 else m << -k"


def value(place: int, y: str, link: int) -> Iterator[str]:
    """Millionths of y into `out`."""
    if link:
        yield from exponential(y, 24, f"out[{place}]")
    else:
        yield f"    w = {y}"
        yield f"    out[{place}] = (w >> 12) * 15625 + ((w & 4095) * 15625 >> 12) + 32 >> 6"
