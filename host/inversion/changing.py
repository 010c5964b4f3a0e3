"""A lump that some strokes feel otherwise than the first: the changes are the last unknowns of its class.

Lengths in mm.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
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
"""Of every class with a lump, by a second visit."""
LATER = tuple(unknown.name for unknown in CHANGES)


def changing(single: Class, changes: Sequence[Unknown] = CHANGES) -> Class:
    """A class with changes; `case` is the first stroke's.

    A change is called after what it is added to, with whatever tells it from others in brackets.
    """
    k = len(single.unknowns)
    return replace(single, unknowns=(*single.unknowns, *changes), case=lambda theta: single.case(theta[:k]))


def added(of: Class, changes: Collection[str]) -> Floats:
    """What adds some of a class's changes to its unknowns, (k, k)."""
    names = [unknown.name for unknown in of.unknowns]
    T = np.eye(len(names))
    for k, name in enumerate(names):
        if name in changes:
            T[names.index(name.removeprefix(CHANGE).partition("(")[0].strip()), k] = 1.0
    return T


def as_changed(of: Class, changes: Collection[str]) -> Class:
    """A class as it is felt after some of its changes."""
    T = added(of, changes)
    return replace(of, case=lambda theta: of.case(T @ theta))
