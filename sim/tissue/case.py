"""A case: the lump, the tissue round it and the probe pressed on it, with its readable code.

Units: mm, kPa, N per metre of probe width (1 N/m = 1 kPa mm).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, fields
from decimal import Decimal

from sim.tissue.errors import CaseError

FORCE_UNIT_N_PER_M = 100.0
"""F = 1.0 of a code, in N per metre of probe width (strain 19.7 % in the reference case)."""

NONLINEAR_E_RATIO = 1.0
NONLINEAR_STIFFENING = 900.0
"""The nonlinear lump of `eNL`: at rest as soft as fat, over E = 10 under the probe (docs/physics.md)."""

LIKE_FAT = 1.0001
"""E of a lump as stiff as fat; exactly 1 would be no lump at all, and the gland would go on in its place."""

_CODE = re.compile(r"d([^dhef_]+)h([^dhef_]+)e([^dhef_]+)f([^dhef_]+)((?:_[A-Za-z]+[^_]+)*)")
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_TENTHS = {"h", "f"}

# Suffix of the code, field, smallest and largest value that makes sense.
_OPTIONS: dict[str, tuple[str, float, float]] = {
    "R": ("probe_radius_mm", 5.0, math.inf),
    "w": ("face_half_mm", 0.0, 40.0),
    "k": ("fillet_per_mm2", 0.005, 10.0),
    "mu": ("friction", 0.0, 0.5),
    "g": ("gland_mm", 1.0, 200.0),
    "G": ("gland_ratio", 0.1, 1000.0),
    "Y": ("fat_kPa", 0.01, 10000.0),
    "nu": ("poisson", 0.3, 0.49999),
    "sf": ("fat_stiffening", 0.0, 2000.0),
    "sg": ("gland_stiffening", 0.0, 2000.0),
    "sl": ("lump_stiffening", 0.0, 2000.0),
}
_MAIN: dict[str, tuple[str, float, float]] = {
    "d": ("d_mm", 0.5, 100.0),
    "h": ("h", 0.02, 50.0),
    "e": ("E_ratio", 0.01, 1e6),
    "f": ("F_rel", 1e-3, 100.0),
}


@dataclass(frozen=True)
class Case:
    """One thing to simulate (thesis, "Definition of Input Parameters").

    Parameters
    ----------
    d_mm : float
        Diameter of the lump. It is centred on the border between fat and gland, under position 0.
        A lump beside the stroke's line is out of reach of a plane-strain model.
    h : float
        Thickness of the fat over the lump, in diameters; the fat is `t_mm` = d (h + 1/2) thick.
    E_ratio : float
        Stiffness of the lump at rest over that of the fat. Exactly 1 means no lump at all.
    F_rel : float
        Force on the probe in units of 100 N per metre of probe width.
    lump_stiffening, fat_stiffening, gland_stiffening : float
        b of the law W = mu/(2b) (exp(b (l1 - l2)^2) - 1); 0 is linear elasticity at large strain.
    fat_kPa : float
        Young's modulus of the fat, kPa.
    gland_ratio : float
        Stiffness of the gland over that of the fat.
    poisson : float
        Poisson's ratio of all three.
    gland_mm : float
        Depth of the gland, between the fat and the fixed chest wall.
    probe_radius_mm : float
        Radius of the probe's face; `math.inf` is a flat one.
    face_half_mm : float
        Beyond this distance from its middle the face is rounded off.
    fillet_per_mm2 : float
        How sharply: the height there grows by fillet/6 (|s| - face_half)^3 mm.
    friction : float
        Coulomb coefficient of the sliding probe; 0 is frictionless.

    Raises
    ------
    CaseError
        A value is not finite or outside what makes sense.
    """

    d_mm: float
    h: float
    E_ratio: float
    F_rel: float = 1.0
    lump_stiffening: float = 0.0
    fat_stiffening: float = 0.0
    gland_stiffening: float = 0.0
    fat_kPa: float = 10.0
    gland_ratio: float = 6.0
    poisson: float = 0.495
    gland_mm: float = 15.0
    probe_radius_mm: float = 40.0
    face_half_mm: float = 10.0
    fillet_per_mm2: float = 0.1
    friction: float = 0.0

    def __post_init__(self) -> None:
        for name, low, high in (*_MAIN.values(), *_OPTIONS.values()):
            raw = getattr(self, name)
            try:
                value = float(raw)
            except (TypeError, ValueError):
                raise CaseError(f"{name} must be a number, not {raw!r}") from None
            if math.isnan(value) or not low <= value <= high or (math.isinf(value) and high < math.inf):
                raise CaseError(f"{name} must lie between {low:g} and {high:g}, not {value:g}")
            object.__setattr__(self, name, value)

    @property
    def t_mm(self) -> float:
        """Thickness of the fat, mm."""
        return self.d_mm * (self.h + 0.5)

    @property
    def depth_mm(self) -> float:
        """Thickness of the fat over the lump, mm."""
        return self.d_mm * self.h

    @property
    def F_N_per_m(self) -> float:
        """Force per metre of probe width, N/m."""
        return FORCE_UNIT_N_PER_M * self.F_rel

    @property
    def has_lump(self) -> bool:
        """False where the lump is as stiff as the fat, which the thesis uses for "no lump"."""
        return self.E_ratio != 1.0 or self.lump_stiffening > 0.0

    @property
    def nonlinear_lump(self) -> bool:
        """True for a lump that stiffens with strain."""
        return self.lump_stiffening > 0.0

    @classmethod
    def without_lump(cls, t_mm: float, F_rel: float = 1.0, **options: float) -> Case:
        """Plain fat of thickness `t_mm` over gland, as a case with E = 1."""
        if not 0.3 <= t_mm <= 200.0:
            raise CaseError(f"t_mm must lie between 0.3 and 200, not {t_mm:g}")
        d = min(20.0, max(min(5.0, t_mm / 0.7), t_mm / 1.3))
        return cls(d_mm=d, h=t_mm / d - 0.5, E_ratio=1.0, F_rel=F_rel, **options)

    @classmethod
    def from_code(cls, code: str) -> Case:
        """Read a code such as `d10h08e10f10`, `d10h08eNLf10` or `d12.3h0.85e7.4f0.66_R60_mu0.2`.

        Two digits after `d` and `e` are mm and the ratio, after `h` and `f` tenths; `e1K` is 1000 and
        `eNL` the nonlinear lump. A number with a point means itself. After `_` come options.

        Raises
        ------
        CaseError
            The code cannot be read or describes an impossible case.
        """
        match = _CODE.fullmatch(code.strip())
        if match is None:
            raise CaseError(f"{code!r} is not a case code; write one like d10h08e10f10")
        values: dict[str, float] = {}
        for letter, text in zip("dhef", match.groups()[:4]):
            name = _MAIN[letter][0]
            if letter == "e" and text == "NL":
                values.update(E_ratio=NONLINEAR_E_RATIO, lump_stiffening=NONLINEAR_STIFFENING)
            else:
                values[name] = _read_number(code, letter, text)
        for option in filter(None, match.group(5).split("_")):
            key = re.match(r"[A-Za-z]+?(?=inf$|\d)", option)
            if key is None or key.group() not in _OPTIONS:
                known = ", ".join(_OPTIONS)
                raise CaseError(f"{code!r} has an unknown option {option!r}; known are {known}")
            values[_OPTIONS[key.group()][0]] = _read_number(code, "", option[key.end() :])
        return cls(**values)

    @property
    def code(self) -> str:
        """The shortest code that `from_code` reads back as exactly this case."""
        thesis_nl = (self.E_ratio, self.lump_stiffening) == (NONLINEAR_E_RATIO, NONLINEAR_STIFFENING)
        e = "NL" if thesis_nl else "1K" if self.E_ratio == 1000.0 else _write_number("e", self.E_ratio)
        text = f"d{_write_number('d', self.d_mm)}h{_write_number('h', self.h)}e{e}"
        text += f"f{_write_number('f', self.F_rel)}"
        defaults = {f.name: f.default for f in fields(self)}
        for key, (name, _, _) in _OPTIONS.items():
            value = getattr(self, name)
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


THESIS_CODES: tuple[str, ...] = (
    *(f"d10h08e10f{f}" for f in ("10", "02", "04", "06", "08")),
    *(f"d10h08e{e}f10" for e in ("02", "05", "50", "1K")),
    *("d10h08e02f06", "d10h08e05f06", "d10h08e05f03", "d10h08e1Kf02", "d10h08e1Kf06", "d10h08e50f04"),
    *(f"d{d}h08e10f10" for d in ("05", "15", "20")),
    *(f"d10h{h}e10f10" for h in ("03", "05", "12", "15")),
    *("d05h15e10f10", "d20h03e10f10", "d15h05e10f10", "d20h05e10f10", "d05h12e10f10"),
    *("d15h05e05f10", "d15h03e02f10"),
    "d10h08eNLf10",
)
"""The thesis' thirty runs: 29 linear ones, the reference first, and the nonlinear one."""
