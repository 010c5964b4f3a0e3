"""Which linear lump a lump feels like: by the strain over it, as the thesis compares them (Figure 15)."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.sim.tissue import LIKE_FAT, Case, load_curve

STIFFNESSES = (LIKE_FAT, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0, 50.0, 1000.0)


def strains(case: Case, forces: Sequence[float]) -> np.ndarray:
    """Nominal strain over the lump under each force."""
    return np.array([stroke.strain[0] for stroke in load_curve(case, forces)])


@functools.cache
def _linear(case: Case, forces: tuple[float, ...]) -> np.ndarray:
    return np.array([strains(replace(case, E_ratio=E), forces) for E in STIFFNESSES])


def stiffness_felt(case: Case, forces: Sequence[float]) -> np.ndarray:
    """E of the linear lump with the same strain under each force, between `STIFFNESSES` linear in E^-2/3."""
    curves = _linear(replace(case, lump_stiffening=0.0, E_ratio=1.0), tuple(forces))
    x = np.array(STIFFNESSES) ** (-2 / 3)
    at = [np.interp(s, c[::-1], x[::-1]) for s, c in zip(strains(case, forces), curves.T)]
    return np.array(at) ** -1.5
