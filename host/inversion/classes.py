"""What may lie under the probe: classes of tissue and lump, each with the numbers that are not known of it.

Lengths in mm. The fat's modulus is left out: with moduli and force scaled alike a stroke stays the same, so
every case stands in fat of 10 kPa.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.link.face import Face
from palpate.sim.tissue import Case

Floats = NDArray[np.float64]

FAT_KPA = 10.0
FIELDS = (
    "d_mm", "h", "fat_mm", "E_ratio", "gland_ratio", "gland_mm", "fat_stiffening", "gland_stiffening",
    "probe_radius_mm",
)  # fmt: skip
_DEEPEST = 0.93
"""A lump ends so far down the gland at most; a search that would go deeper moves the chest wall with it."""
_CORNER = 6.0
"""How sharp the corner of that bound is."""
_PLAIN_D_MM = 10.0
STEP = 1e-6
"""Of differences by an unknown."""
PADDING, GLAND = "ln padding", "ln gland"
LARGER, DEEPER, APART = "ln d2 / d", "ln depth2 / depth", "apart"
"""Of a second lump."""
_FLAT_MM = 1e4
_EDGE_MM = 2.0
"""The face is rounded off so far from where its cells end, as our probe's."""


@dataclass(frozen=True)
class Unknown:
    """A number that is not known: its prior, the ends of the search, and the longest step of an iteration."""

    name: str
    mean: float
    sd: float
    low: float
    high: float
    step: float


def differences(said: Callable[[Floats], Sequence[float] | Floats], at: Floats, k: int) -> Floats:
    """Derivatives of what is said, (m,), by the first k numbers, (m, k): central differences."""
    steps = STEP * np.eye(len(at))[:k]
    apart = [np.subtract(said(at + step), said(at - step)) for step in steps]
    out: Floats = np.array(apart).T / (2 * STEP)
    return out


def log_even(name: str, low: float, high: float, least: float, most: float, step: float) -> Unknown:
    """A logarithm, even between low and high; the search ends at least and most."""
    a, b = np.log(low), np.log(high)
    return Unknown(name, (a + b) / 2, (b - a) / np.sqrt(12), np.log(least), np.log(most), step)


_D = Unknown("ln d", np.log(11.5), 0.40, np.log(3.0), np.log(35.0), 0.2)
_DEPTH = log_even("ln depth", 2.0, 30.0, 1.0, 60.0, 0.25)
_FAT = log_even("ln t", 4.0, 30.0, 2.5, 60.0, 0.25)
_STIFFNESS = Unknown("E^-2/3", 0.32, 0.18, 0.003, 0.97, 0.08)
_TISSUE = (
    log_even("ln gland ratio", 1.0, 10.0, 0.7, 16.0, 0.4),
    Unknown(GLAND, np.log(17.5), 0.38, np.log(5.0), np.log(45.0), 0.3),
    Unknown("b of the fat", 1.27, 0.96, 0.0, 6.0, 0.8),
    Unknown("b of the gland", 1.27, 0.96, 0.0, 6.0, 0.8),
    Unknown("ln R", np.log(40.0), 0.029, np.log(34.0), np.log(46.0), 0.03),
)


@dataclass(frozen=True)
class Class:
    """One kind of tissue and lump.

    Attributes
    ----------
    name : str
    unknowns : tuple of Unknown
    case : callable
        The case for their values (k,), in fat of 10 kPa.
    fields : tuple of str
        The case's fields that they move.
    """

    name: str
    unknowns: tuple[Unknown, ...]
    case: Callable[[Floats], Case]
    fields: tuple[str, ...]

    @property
    def lump(self) -> bool:
        """Whether there is one."""
        return self.unknowns[0].name == _D.name

    def values(self, theta: Floats) -> Floats:
        """The case's `fields`."""
        case = self.case(theta)
        return np.array([getattr(case, name) for name in self.fields])

    def chain(self, theta: Floats) -> Floats:
        """Derivatives of `fields` by the unknowns, (fields, k)."""
        return differences(self.values, theta, len(theta))

    def column(self, name: str) -> Floats:
        """One attribute of all unknowns, (k,)."""
        return np.array([getattr(unknown, name) for unknown in self.unknowns])

    def within(self, theta: Floats) -> Floats:
        """A guess (k,) no farther than the search goes."""
        out: Floats = np.clip(theta, self.column("low"), self.column("high"))
        return out

    @property
    def scale(self) -> Floats:
        """How far steps of the unknowns, of a place and of ln force usually go, (k + 2,)."""
        return np.concatenate([self.column("sd"), [1.0, 0.1]])


def _tissue(values: Floats, least_gland_mm: float) -> dict[str, Any]:
    ratio, gland, fat_b, gland_b, radius = values
    return {
        "gland_ratio": float(np.exp(ratio)),
        "gland_mm": _at_least(float(np.exp(gland)), least_gland_mm),
        "fat_stiffening": float(max(fat_b, 0.0)),
        "gland_stiffening": float(max(gland_b, 0.0)),
        "probe_radius_mm": float(np.exp(radius)),
    }


def _at_least(value: float, least: float) -> float:
    """The greater of the two, round its corner: where there is no slope no search comes back."""
    return value if least <= 0 else float((value**_CORNER + least**_CORNER) ** (1 / _CORNER))


def _anywhere(theta: Floats) -> Case:
    d, depth, fat = np.exp(theta[:3]).tolist()
    rest = _tissue(theta[4:], (depth + d - fat) / _DEEPEST)
    return Case(d, depth / d, max(theta[3], 0.003) ** -1.5, 0.5, fat_mm=fat, fat_kPa=FAT_KPA, **rest)


def _border(theta: Floats) -> Case:
    d, depth = np.exp(theta[:2]).tolist()
    rest = _tissue(theta[3:], 0.62 * d)
    return Case(d, depth / d, max(theta[2], 0.003) ** -1.5, 0.5, fat_kPa=FAT_KPA, **rest)


def _none(theta: Floats) -> Case:
    rest = _tissue(theta[1:], 0.62 * _PLAIN_D_MM)
    h = max(float(np.exp(theta[0])) / _PLAIN_D_MM - 0.5, 0.02)
    return Case(_PLAIN_D_MM, h, 1.0, 0.5, fat_kPa=FAT_KPA, **rest)


ANYWHERE = Class("anywhere", (_D, _DEPTH, _FAT, _STIFFNESS, *_TISSUE), _anywhere, FIELDS)
BORDER = Class(
    "border", (_D, _DEPTH, _STIFFNESS, *_TISSUE), _border, tuple(f for f in FIELDS if f != "fat_mm")
)
NONE = Class(
    "none",
    (_FAT, *_TISSUE),
    _none,
    ("h", "gland_ratio", "gland_mm", "fat_stiffening", "gland_stiffening", "probe_radius_mm"),
)
CLASSES = {c.name: c for c in (NONE, BORDER, ANYWHERE)}


def under(face: Face, of: Class, half_mm: float) -> Class:
    """A class felt by another face, `half_mm` from its middle to where its cells end."""
    mean = float(np.log(min(face.radius_mm, _FLAT_MM)))
    radius = Unknown("ln R", mean, 0.029, mean - 0.17, mean + 0.17, 0.03)
    unknowns = tuple(radius if unknown.name == radius.name else unknown for unknown in of.unknowns)
    face_half = half_mm - _EDGE_MM
    if not face.padding_mm:
        return replace(of, unknowns=unknowns, case=lambda theta: _faced(of.case(theta), face_half))
    gives = float(np.log(face.yields_mm_per_kPa))
    padding = Unknown(PADDING, gives, 2.0, gives - 3.0, min(gives + 3.0, np.log(0.9)), 0.3)

    def case(theta: Floats) -> Case:
        bare = of.case(theta[:-1])
        return replace(bare, face_half_mm=face_half, padding_mm_per_kPa=float(np.exp(theta[-1])))

    return Class(of.name, (*unknowns, padding), case, (*of.fields, "padding_mm_per_kPa"))


def _faced(case: Case, face_half_mm: float) -> Case:
    """Under a face that is rounded off there."""
    return case if case.face_half_mm == face_half_mm else replace(case, face_half_mm=face_half_mm)
