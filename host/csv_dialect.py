"""Which signs a CSV file uses: separator and decimal sign differ from country to country."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

_LOOKED_AT = 1 << 16
"""Bytes at the file's start that tell."""

COMMA_NUMBER = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
"""A number with a decimal comma."""


class Dialect(NamedTuple):
    """As `pandas.read_csv` takes them."""

    sep: str
    decimal: str


def dialect_of(path: Path) -> Dialect:
    """The separator that the heads use most, and the decimal sign of the rows below them.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    with path.open("rb") as file:
        text = file.read(_LOOKED_AT).decode("utf-8-sig", "replace")
    lines = [line for line in text.splitlines() if line.strip()]
    heads = lines[0] if lines else ""
    sep = max(",;\t", key=heads.count)
    if sep == ",":
        return Dialect(",", ".")
    fields = [field.strip(' "') for line in lines[1:20] for field in line.split(sep)]
    return Dialect(sep, "," if any(map(COMMA_NUMBER.fullmatch, fields)) else ".")
