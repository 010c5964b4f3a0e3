"""The layers of tissue, from the skin down to the chest wall: fat, and what lies under it.

Another layer is a name in `UNDER_FAT` and its three fields in `case.Case`. Its limits, the letters of its
code, its rows in the meshes, its constants and derivatives follow. The lump touches fat and gland only; all
tissue stiffens by the case's one law. Units: mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

UNDER_FAT = ("gland", "muscle")
"""Downwards. Each has three fields of `Case`, `fields_of`. Only the first is always there."""

DEEPER = UNDER_FAT[1:]
"""What a case need not have: its thickness is None then."""

MATERIALS = ("fat", UNDER_FAT[0], "lump", *DEEPER)
"""What elements are made of, by number."""

FAT, GLAND, LUMP = range(3)


@dataclass(frozen=True)
class Layer:
    """A layer of tissue.

    Attributes
    ----------
    name : str
    mm : float
        Its thickness over the lump's middle.
    ratio : float
        Its Young's modulus at rest over that of the fat.
    stiffening : float
        b of the case's law.
    """

    name: str
    mm: float
    ratio: float
    stiffening: float


def fields_of(layer: str) -> tuple[str, str, str]:
    """The fields of `Case` that say thickness, ratio and stiffening of a layer under the fat."""
    return f"{layer}_mm", f"{layer}_ratio", f"{layer}_stiffening"


def letters_of(layer: str) -> dict[str, str]:
    """The letters in a case's code, and the fields that they set: gland has g, G and sg."""
    initial = layer[0]
    return dict(zip((initial, initial.upper(), f"s{initial}"), fields_of(layer)))


def layer_at(height_mm: NDArray[np.float64], borders_mm: Sequence[float]) -> NDArray[np.int64]:
    """Numbers in `MATERIALS` of the layers at these heights; a border belongs to the layer under it."""
    out = np.full(height_mm.shape, FAT)
    for number, border in zip((GLAND, *range(LUMP + 1, len(MATERIALS))), borders_mm):
        out[height_mm <= border] = number
    return out


def by_material(of_layers: Sequence[float], of_lump: float) -> NDArray[np.float64]:
    """A property of each layer, downwards, and of the lump, as `MATERIALS` numbers them."""
    return np.array([*of_layers[:LUMP], of_lump, *of_layers[LUMP:]])


def rows_through(borders_mm: Sequence[float], largest_mm: float, from_mm: float) -> NDArray[np.float64]:
    """Ascending borders of rows through layers that begin at `from_mm`, left out, and end at `borders_mm`."""
    rows: list[float] = []
    above = from_mm
    for below in borders_mm:
        count = max(1, int(np.ceil((above - below) / largest_mm)))
        rows = [*np.linspace(below, above, count + 1)[:-1], *rows]
        above = below
    return np.array(rows)
