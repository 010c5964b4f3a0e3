"""A lump that has changed by a second visit: the changes are the last unknowns of its class.

Lengths in mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.classes import Class, Unknown

Floats = NDArray[np.float64]

CHANGE = "change of"
CHANGES = (
    Unknown(f"{CHANGE} ln d", 0.0, 0.4, -1.5, 1.5, 0.2),
    Unknown(f"{CHANGE} ln depth", 0.0, 0.3, -1.2, 1.2, 0.2),
)
"""Of every class with a lump."""


def changing(single: Class, changes: Sequence[Unknown] = CHANGES) -> Class:
    """A class whose lump is another at the second visit; `case` is the first one's."""
    k = len(single.unknowns)
    return replace(single, unknowns=(*single.unknowns, *changes), case=lambda theta: single.case(theta[:k]))


def later(of: Class) -> Floats:
    """What makes the second visit's unknowns of a changing class's, (k, k): adds the changes."""
    names = [unknown.name for unknown in of.unknowns]
    T = np.eye(len(names))
    for k, name in enumerate(names):
        if name.startswith(CHANGE):
            T[names.index(name.removeprefix(CHANGE).strip()), k] = 1.0
    return T


def as_later(of: Class) -> Class:
    """A changing class as the second visit feels it."""
    T = later(of)
    return replace(of, case=lambda theta: of.case(T @ theta))
