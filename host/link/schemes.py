"""Ports of other people's arrays: `SCHEME:WHERE?OPTIONS`, as flexitac:/dev/ttyUSB0?rows=16&cols=32&pitch=3.

Who reads a scheme is found by entry point (group `palpate.sources`), so that a package of one's own adds one.
Imports nothing of the firmware: the array must be known before that is imported.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import parse_qsl

from palpate.errors import MissingExtra, UsageError

GROUP = "palpate.sources"
_UNITS = {"pitch": "mm", "full": "kPa", "radius": "mm", "padding": "mm", "modulus": "kPa"}
_PORT = re.compile(r"([a-z][a-z0-9_-]+):(?!//)([^?]*)(?:\?(.*))?")


@dataclass(frozen=True)
class Address:
    """What `--port` says of somebody's array.

    Parameters
    ----------
    text, scheme, where : str
        All of it, who reads it, and the port that it is on.
    options : dict
        What stands behind the question mark.
    """

    text: str
    scheme: str
    where: str
    options: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """What its calibration is kept under: `name=`, else scheme and port."""
        return self.options.get("name") or re.sub(r"\W+", "-", f"{self.scheme}-{self.where.split('/')[-1]}")


def address_of(port: str) -> Address | None:
    """The address in a port's name; None where it is a port like any other.

    Raises
    ------
    UsageError
        It names no port, or an option without a value, or one twice.
    """
    if (told := _PORT.fullmatch(port)) is None:
        return None
    scheme, where, query = told.groups("")
    try:
        pairs = parse_qsl(query, strict_parsing=bool(query), keep_blank_values=True)
    except ValueError:
        raise UsageError(f"{query!r} are no options: write NAME=VALUE, several with & between") from None
    options = dict(pairs)
    if not re.fullmatch(r"[\w-]*", options.get("name", "")):
        raise UsageError(f"name={options['name']}: letters, digits, _ and - make a name")
    if len(options) < len(pairs):
        raise UsageError(f"an option stands twice in {port!r}")
    if not where:
        raise UsageError(
            f"{port!r} names no port: write {scheme}:/dev/ttyUSB0 or {scheme}:socket://HOST:PORT"
        )
    return Address(port, scheme, where, options)


def source_of(address: Address) -> Any:
    """The class that reads this scheme, a `palpate.sources.ArrayLine`.

    Raises
    ------
    UsageError
        Nobody has registered one.
    MissingExtra
        It needs a package that is not installed.
    """
    from importlib.metadata import entry_points  # slow to import

    known = {entry.name: entry for entry in entry_points(group=GROUP)}
    if address.scheme not in known:
        raise UsageError(
            f"nothing here reads {address.scheme!r}: there are {', '.join(sorted(known)) or 'none'}; "
            "docs/howto/your-own-array.md says how to add one"
        )
    try:
        return known[address.scheme].load()
    except ModuleNotFoundError as error:
        raise MissingExtra(str(error.name), address.scheme, f"reading {address.scheme}") from error


def use_array_of(port: str) -> None:
    """Work with the array that a port's name describes, where it describes one.

    Raises
    ------
    UsageError
        It is not described, or none that Palpate can work with.
    """
    if (address := address_of(port)) is not None:
        from palpate import array

        array.use(array.words_of(*source_of(address).shape(address.options)))


def number(options: dict[str, Any], name: str, unless_told: float | None = None) -> float:
    """A positive number among the options; units that are told must be the usual ones.

    Raises
    ------
    UsageError
        It is missing and there is no value to take instead, or it is none.
    """
    unit = _UNITS.get(name, "")
    if name not in options:
        if unless_told is None:
            example = "rows=16&cols=32&pitch=3mm" if name in ("rows", "cols", "pitch") else f"{name}=40{unit}"
            raise UsageError(f"say {name}= of the array, as {example}")
        return unless_told
    try:
        value = float(str(options[name]).removesuffix(unit) if unit else options[name])
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise UsageError(f"{name}={options[name]} is no positive number" + (f" of {unit}" if unit else ""))
    return value
