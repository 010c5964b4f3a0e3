"""The face of somebody's array in words: `radius=flat`, or `radius=40mm&padding=2mm&modulus=80kPa`.

Rows, columns, pitch and full scale are the array's own (`palpate.array`); these are what the inversion needs
besides. They stand in a port's name, which every recording keeps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from urllib.parse import parse_qsl

from palpate.errors import UsageError
from palpate.link.schemes import Address, number

OPTIONS = ("radius", "padding", "modulus")


@dataclass(frozen=True)
class Face:
    """What presses on the skin.

    Parameters
    ----------
    radius_mm : float
        Along the rows, at the lowest point; `math.inf` is flat.
    padding_mm, modulus_kPa : float
        Thickness and modulus in compression of what lies between cells and skin; 0 mm: nothing.
    """

    radius_mm: float
    padding_mm: float = 0.0
    modulus_kPa: float = math.inf

    @property
    def yields_mm_per_kPa(self) -> float:
        """How far the padding gives way."""
        return self.padding_mm / self.modulus_kPa


def face_of(options: dict[str, str]) -> Face | None:
    """The face that options describe; None where they say nothing of it.

    Raises
    ------
    UsageError
        A number is none, or the description is not whole.
    """
    if not set(OPTIONS) & set(options):
        return None
    if ("padding" in options) != ("modulus" in options):
        raise UsageError("a padding has a thickness and a modulus: padding=2mm&modulus=80kPa")
    radius = math.inf if options.get("radius") == "flat" else number(options, "radius")
    if radius < 5.0:
        raise UsageError(f"radius={options['radius']} is too sharp: a face has 5 mm and more, or is flat")
    if "padding" not in options:
        return Face(radius)
    face = Face(radius, number(options, "padding"), number(options, "modulus"))
    if face.yields_mm_per_kPa > 0.5:
        raise UsageError(
            f"padding={options['padding']}&modulus={options['modulus']} gives way by more than "
            "0.5 mm under 1 kPa; check the units, mm and kPa"
        )
    return face


def face_in_words(text: str) -> Face:
    """The face of `--face`; raises UsageError."""
    try:
        options = dict(parse_qsl(text, strict_parsing=True))
    except ValueError:
        options = {}
    unknown = set(options) - set(OPTIONS)
    if unknown or (face := face_of(options)) is None:
        raise UsageError(
            f"{text!r} describes no face: write radius=flat, or radius=40mm&padding=2mm&modulus=80kPa"
        )
    return face


def face_at(address: Address | None) -> Face | None:
    """The face that a port's name describes."""
    return None if address is None else face_of(address.options)
