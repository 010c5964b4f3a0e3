"""The readable code of a case, such as `d10h08e10f10` or `d12.3h0.85e7.4f0.66_R60_ball_y5`.

Two digits after `d` and `e` are mm and the ratio, after `h` and `f` tenths; `e1K` is 1000 and `eNL` the
nonlinear lump. A number with a point means itself. After `_` come options, each at most once and in any
order: `_ball`, `_ellipsoid8x4` (half-axes across and down, mm), or letters and a number (`OPTIONS`).
"""

from __future__ import annotations

import math
import re
from dataclasses import fields
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.layers import DEEPER, letters_of

if TYPE_CHECKING:
    from palpate.sim.tissue.case import Case

_CODE = re.compile(r"d([^dhef_]+)h([^dhef_]+)e([^dhef_]+)f([^dhef_]+)((?:_[A-Za-z]+[^_]*)*)")
_NUMBER = re.compile(r"[0-9]+(?:\.[0-9]+)?")
_OPTION = re.compile(r"([A-Za-z]+?)(inf|-?[0-9].*)")
_AXES = re.compile(r"ellipsoid([0-9.]+)x([0-9.]+)")
_MAIN = {"d": "d_mm", "h": "h", "e": "E_ratio", "f": "F_rel"}
_TENTHS = {"h", "f"}

OPTIONS = {
    "R": "probe_radius_mm",
    "w": "face_half_mm",
    "k": "fillet_per_mm2",
    "mu": "friction",
    "g": "gland_mm",
    "G": "gland_ratio",
    "Y": "fat_kPa",
    "nu": "poisson",
    "sf": "fat_stiffening",
    "sg": "gland_stiffening",
    "sl": "lump_stiffening",
    "y": "offset_mm",
    "t": "fat_mm",
    "p": "padding_mm_per_kPa",
    "Ra": "across_radius_mm",
    "wa": "across_half_mm",
    "ka": "across_fillet_per_mm2",
}
for _layer in DEEPER:
    OPTIONS |= letters_of(_layer)
"""Letters of an option and the field that it sets."""


def read_code(code: str) -> dict[str, Any]:
    """The fields that a code sets.

    Raises
    ------
    CaseError
        The code cannot be read, or says something twice.
    """
    from palpate.sim.tissue.case import LAWS, NONLINEAR_E_RATIO, NONLINEAR_STIFFENING

    match = _CODE.fullmatch(code.strip())
    if match is None:
        raise CaseError(f"{code!r} is not a case code; write one like d10h08e10f10")
    values: dict[str, Any] = {}
    plain = _plain_shapes()

    def put(name: str, value: float | str) -> None:
        if name in values:
            raise CaseError(f"{code!r} is not a case code: it gives {name} twice")
        values[name] = value

    for letter, text in zip("dhef", match.groups()[:4]):
        if letter == "e" and text == "NL":
            put("E_ratio", NONLINEAR_E_RATIO)
            put("lump_stiffening", NONLINEAR_STIFFENING)
        else:
            put(_MAIN[letter], _read_number(code, letter, text))
    for option in filter(None, match.group(5).split("_")):
        if option in plain:
            put("shape", option)
        elif option in LAWS[1:]:
            put("law", option)
        elif axes := _AXES.fullmatch(option):
            put("shape", "ellipsoid")
            for name, text in zip(("half_across_mm", "half_down_mm"), axes.groups()):
                put(name, _read_number(code, "", text))
        elif (key := _OPTION.fullmatch(option)) and key.group(1) in OPTIONS:
            name, text = OPTIONS[key.group(1)], key.group(2)
            minus = name == "offset_mm" and text.startswith("-")
            number = _read_number(code, "", text[1:] if minus else text)
            put(name, -number if minus else number)
        else:
            known = ", ".join((*plain, "ellipsoidAxB", *LAWS[1:], *OPTIONS))
            raise CaseError(f"{code!r} has an unknown option {option!r}; known are {known}")
    return values


def _plain_shapes() -> tuple[str, ...]:
    """Shapes that are said by their name alone; a cylinder goes without saying."""
    from palpate.sim.tissue.case import SHAPES

    return tuple(shape for shape, (across, _) in SHAPES.items() if across is not None and shape != "cylinder")


def write_code(case: Case) -> str:
    """The shortest code that `read_code` reads back as exactly this case."""
    from palpate.sim.tissue.case import LAWS, NONLINEAR_E_RATIO, NONLINEAR_STIFFENING

    thesis_nl = (case.E_ratio, case.lump_stiffening) == (NONLINEAR_E_RATIO, NONLINEAR_STIFFENING)
    e = "NL" if thesis_nl else "1K" if case.E_ratio == 1000.0 else _write_number("e", case.E_ratio)
    text = f"d{_write_number('d', case.d_mm)}h{_write_number('h', case.h)}e{e}"
    text += f"f{_write_number('f', case.F_rel)}"
    if case.shape in _plain_shapes():
        text += f"_{case.shape}"
    elif case.half_across_mm is not None and case.half_down_mm is not None:
        text += f"_ellipsoid{_plain(case.half_across_mm)}x{_plain(case.half_down_mm)}"
    if case.law in LAWS[1:]:
        text += f"_{case.law}"
    defaults = {f.name: f.default for f in fields(case)}
    for key, name in OPTIONS.items():
        value = getattr(case, name)
        if value != defaults[name] and not (name == "lump_stiffening" and thesis_nl):
            text += f"_{key}{_plain(value)}"
    return text


def _read_number(code: str, letter: str, text: str) -> float:
    if letter == "e" and text == "1K":
        return 1000.0
    if not letter and text == "inf":
        return math.inf
    if not _NUMBER.fullmatch(text):
        raise CaseError(f"{code!r} is not a case code: {text!r} is not a number")
    if letter in _TENTHS and "." not in text:
        if len(text) != 2:
            raise CaseError(f"{code!r} is not a case code: {letter} takes two digits (tenths) or a point")
        return int(text) / 10
    return float(text)


def _write_number(letter: str, value: float) -> str:
    if letter in _TENTHS:
        tenths = round(value * 10)
        if 0 <= tenths < 100 and tenths / 10 == value:
            return f"{tenths:02d}"
    elif value == int(value) and value < 100:
        return f"{int(value):02d}"
    text = _plain(value)
    return text if "." in text else text + ".0"


def _plain(value: float) -> str:
    """Shortest decimal without an exponent that reads back as the same float."""
    if math.isinf(value):
        return "inf"
    text = format(Decimal(repr(value)), "f")
    return text[:-2] if text.endswith(".0") else text
