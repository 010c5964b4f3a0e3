"""A stroke's fit by the forward model, whoever shows or keeps it. Units in the names."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.spans import BORDER

Floats = NDArray[np.float64]

LEVEL = 0.9
"""Coverage that the intervals are meant to have."""
HARD = BORDER ** (-2 / 3)
"""E^-2/3 of a lump between hard and soft."""
ROWS = (
    ("d_mm", "Diameter", "mm"),
    ("width_mm", "Width across", "mm"),
    ("depth_mm", "Depth", "mm"),
    ("d2_mm", "Second diameter", "mm"),
    ("depth2_mm", "Second depth", "mm"),
    ("apart_mm", "Apart", "mm"),
    ("E_kPa", "Lump's modulus", "kPa"),
    ("t_mm", "Fat's thickness", "mm"),
    ("E_fat_kPa", "Fat's modulus", "kPa"),
)
"""What is shown of it: name, words, unit."""
TITLES = {
    "none": "Fitted: no lump",
    "border": "Fitted: a lump on the border",
    "anywhere": "Fitted: a lump",
    "ball": "Fitted: a ball",
    "ellipsoid": "Fitted: an ellipsoid",
    "two lumps": "Fitted: two lumps",
}
_LEAST = 0.005
"""Odds below are not worth a word."""
_DIGITS = 3


@dataclass(frozen=True)
class Value:
    """An estimate and its 90 % interval; an end that nobody knows is None."""

    value: float
    low: float | None
    high: float | None

    def as_dict(self) -> dict[str, float | None]:
        """As `--json` prints it."""
        return {"value": self.value, "low": self.low, "high": self.high}


@dataclass(frozen=True)
class Laid:
    """The fitted stroke over the measured one, in the n frames that the misfit counts.

    Attributes
    ----------
    place_mm : ndarray (n,)
        Of the probe; of a press alone 0.
    press : int
        How many of the first frames came before the probe moved.
    measured_kPa, fitted_kPa : ndarray (n, rows)
        Means of each row's live cells; the fitted ones as these sensors would have read them.
    measured_mm, fitted_mm : ndarray (n,)
        Displacements.
    """

    place_mm: Floats
    press: int
    measured_kPa: Floats
    fitted_kPa: Floats
    measured_mm: Floats
    fitted_mm: Floats

    @property
    def residual_kPa(self) -> Floats:
        """Measured less fitted, (n, rows)."""
        return self.measured_kPa - self.fitted_kPa

    def as_dict(self) -> dict[str, Any]:
        """Plain lists, to a pascal and a micrometre."""
        return {
            f.name: np.round(value, _DIGITS).tolist()
            if isinstance(value := getattr(self, f.name), np.ndarray)
            else value
            for f in fields(self)
        }

    @classmethod
    def from_dict(cls, found: dict[str, Any]) -> Laid:
        """What `as_dict` has made."""
        arrays = {name: np.asarray(value, float) for name, value in found.items() if name != "press"}
        return cls(press=int(found["press"]), **arrays)


@dataclass(frozen=True)
class Inverted:
    """One stroke's inversion.

    Attributes
    ----------
    stroke : int
        Its number on the probe; of a press alone in its recording.
    values : dict
        `Value` by name: t_mm, E_fat_kPa, F_N_per_m, gland_mm, gland_ratio; with a lump d_mm, h, depth_mm,
        E_inv23, E_ratio and E_kPa; of a solid one width_mm, across the stroke; of two d2_mm, depth2_mm and
        apart_mm, middle to middle: the second lies farther along the stroke and is as stiff.
    kind : str
        The class that the values belong to.
    classes : dict
        The odds of each class that was compared, between 0 and 1.
    chi2 : float
        Misfit for each degree of freedom.
    fits : bool
    settled : bool
        Whether the search came to rest.
    worst : str
        Where the misfit is greatest, in words.
    centre_mm : float or None
        Where the lump lies along the stroke.
    why : str
        Why it does not fit, in words.
    layers : dict
        How likely the lump lies in the "fat" alone, across its "border", in the "gland" alone.
    together : int
        How many strokes this is the answer to.
    problem : str
        Why there is no inversion; then all else is empty.
    press : bool
        Whether it was a press alone.
    laid : tuple of Laid
        For each stroke that it answers: the fitted one over the measured one.
    """

    stroke: int
    values: dict[str, Value] = field(default_factory=dict)
    kind: str = ""
    classes: dict[str, float] = field(default_factory=dict)
    chi2: float | None = None
    fits: bool = False
    settled: bool = False
    worst: str = ""
    centre_mm: float | None = None
    why: str = ""
    layers: dict[str, float] = field(default_factory=dict)
    together: int = 1
    problem: str = ""
    press: bool = False
    laid: tuple[Laid, ...] = ()

    @property
    def lump(self) -> bool:
        """Whether the best class has a lump."""
        return self.kind not in ("", "none")

    @property
    def hardness(self) -> str:
        """hard, soft or unsure: whether the lump is more than ten times as stiff as the fat."""
        s = self.values.get("E_inv23")
        if s is None or s.low is None or s.high is None:
            return "unsure"
        return "hard" if s.high < HARD else "soft" if s.low > HARD else "unsure"

    @property
    def odds(self) -> str:
        """Of the classes that are worth a word."""
        return ", ".join(f"{name} {share:.0%}" for name, share in self.classes.items() if share > _LEAST)

    @property
    def verdict(self) -> str:
        """Whether it fits, in a sentence or two."""
        return "It fits." if self.fits else f"It does not fit: {self.why}. Believe none of its numbers."

    def as_dict(self) -> dict[str, Any]:
        """As `--json` prints it."""
        return {
            "stroke": self.stroke,
            "press": self.press,
            "problem": self.problem,
            "lump": self.lump,
            **{name: value.as_dict() for name, value in self.values.items()},
            "hardness": self.hardness if self.lump else None,
            "centre_mm": self.centre_mm,
            "class": self.kind or None,
            "classes": self.classes,
            "fits": self.fits,
            "chi2": self.chi2,
            "settled": self.settled,
            "worst": self.worst,
            "why": self.why,
            "layers": self.layers,
            "together": self.together,
            "level": LEVEL,
        }

    @classmethod
    def from_dict(cls, found: dict[str, Any]) -> Inverted:
        """What `as_dict` has made, but for what it was laid over."""
        own = {f.name: found[f.name] for f in fields(cls) if f.name in found}
        values = {
            name: Value(**value)
            for name, value in found.items()
            if isinstance(value, dict) and set(value) == {"value", "low", "high"}
        }
        return cls(**own, values=values, kind=found["class"] or "")


@dataclass(frozen=True)
class Change:
    """Two visits to one lump, fitted together.

    Attributes
    ----------
    before, after : Inverted
        Each visit's lump, in the tissue that they share.
    ratio : dict
        `Value` of d_mm and depth_mm: what they are at the second visit, over the first.
    fits : bool
    """

    before: Inverted
    after: Inverted
    ratio: dict[str, Value]
    fits: bool

    def as_dict(self) -> dict[str, Any]:
        """As `--json` prints it."""
        return {
            "before": self.before.as_dict(),
            "after": self.after.as_dict(),
            "ratio": {name: value.as_dict() for name, value in self.ratio.items()},
            "fits": self.fits,
        }
