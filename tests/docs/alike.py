"""Whether what a page shows is what a command printed."""

from __future__ import annotations

import re


def differs(shown: str, printed: str) -> str:
    """The first line of a `text` block that is not in what was printed, in order; "" where all are.

    `...` stands for anything within a line, a line of `...` for any lines; numbers may differ by 2 %, since
    another machine rounds otherwise.
    """
    rest = [_words(line) for line in printed.splitlines()]
    for line in shown.splitlines():
        if not line.strip() or line.strip() == "...":
            continue
        wanted = _words(line)
        while rest and not _alike(wanted, rest[0]):
            rest.pop(0)
        if not rest:
            return line
        rest.pop(0)
    return ""


def _words(line: str) -> list[str]:
    return re.findall(r"\.\.\.|-?\d+(?:\.\d+)?(?:e-?\d+)?|\w+|[^\w\s]", line)


def _alike(wanted: list[str], heard: list[str]) -> bool:
    if not wanted:
        return not heard
    if wanted[0] == "...":
        return any(_alike(wanted[1:], heard[k:]) for k in range(len(heard) + 1))
    if not heard:
        return False
    return _same(wanted[0], heard[0]) and _alike(wanted[1:], heard[1:])


def _same(a: str, b: str) -> bool:
    if a == b:
        return True
    try:
        return abs(float(a) - float(b)) <= 0.02 * abs(float(a)) + 1e-12
    except ValueError:
        return False
