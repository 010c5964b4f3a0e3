"""What may lie under the probe where its sides are felt: a ball, an ellipsoid with a width and a height of
its own, or no lump.

The border between fat and gland passes through their middle, as in the strokes that the emulator has learnt
from. Lengths in mm; fat of 10 kPa, as in `classes`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.inversion.changing import CHANGE, changing
from palpate.inversion.classes import FAT_KPA, Class, Unknown, log_even
from palpate.sim.tissue import Case

Floats = NDArray[np.float64]

WIDTH, HEIGHT, OFFSET = "ln width/d", "ln height/d", "offset"
RATIO = "ln gland ratio"
ERROR = "emulator's error"
_FIELDS = ("t_mm", "depth_mm", "d_mm", "E_ratio", "gland_ratio", "gland_mm", "offset_mm")

_D = log_even("ln d", 5.0, 20.0, 3.6, 25.0, 0.2)
_DEPTH = log_even("ln depth", 2.0, 27.0, 1.0, 40.0, 0.25)
_FAT = log_even("ln t", 4.5, 37.0, 3.5, 45.0, 0.25)
_PLAIN_D_MM = 5.0
_STIFFNESS = Unknown("E^-2/3", 0.32, 0.18, 0.003, 0.72, 0.08)
_ASPECT_SD = 0.28
"""Of ln width and ln height over ln d, where the lump is no ball."""
_LAYERS = (
    log_even(RATIO, 1.0, 10.0, 0.9, 12.0, 0.4),
    Unknown("ln gland", np.log(17.5), 0.38, np.log(7.0), np.log(36.0), 0.3),
    Unknown("b of the fat", 1.5, 0.87, 0.0, 3.6, 0.8),
    Unknown("b of the gland", 1.5, 0.87, 0.0, 3.6, 0.8),
    Unknown("ln R", np.log(40.0), 0.029, np.log(37.0), np.log(43.0), 0.03),
)
_TISSUE = (*_LAYERS, Unknown(OFFSET, 0.0, 4.0, -11.0, 11.0, 1.0))


def _case(d: float, width: float, height: float, depth: float, s: float, tissue: Floats) -> Case:
    ratio, gland, fat_b, gland_b, radius, offset = tissue
    return Case(
        d, depth / d, max(s, 0.003) ** -1.5, 0.5, fat_kPa=FAT_KPA, shape="ellipsoid",
        half_across_mm=width / 2, half_down_mm=height / 2, offset_mm=float(offset),
        gland_ratio=float(np.exp(ratio)), gland_mm=float(max(np.exp(gland), 0.55 * height + 1.0)),
        fat_stiffening=float(max(fat_b, 0.0)), gland_stiffening=float(max(gland_b, 0.0)),
        probe_radius_mm=float(np.exp(radius)),
    )  # fmt: skip


def _ball(theta: Floats) -> Case:
    d, depth = np.exp(theta[:2]).tolist()
    return _case(d, d, d, depth, float(theta[2]), theta[3:9])


def _ellipsoid(theta: Floats) -> Case:
    d, depth = np.exp(theta[:2]).tolist()
    width, height = np.exp(theta[:1] + theta[9:11]).tolist()
    return _case(d, width, height, depth, float(theta[2]), theta[3:9])


def _none(theta: Floats) -> Case:
    d, t = _PLAIN_D_MM, float(np.exp(theta[0]))
    return _case(d, d, d, t - d / 2, 1.0, np.append(theta[1:6], 0.0))


def moved(stroke: int) -> str:
    """What a stroke's line lies beside the first one's: a hand does not stroke along one line twice."""
    return f"{CHANGE} {OFFSET} (stroke {stroke + 1})"


def moving(of: Class, strokes: int) -> Class:
    """A class that strokes feel, each along a line of its own."""
    return changing(of, [Unknown(moved(k), 0.0, 3.0, -11.0, 11.0, 1.0) for k in range(1, strokes)])


def learnt(of: Class, ratios: tuple[float, float], components: int) -> Class:
    """The class as an emulator knows it.

    Parameters
    ----------
    ratios : tuple of float
        Least and greatest stiffness of the gland over the fat's that it has learnt from.
    components : int
        What it may get wrong, each of unit spread: further unknowns.
    """
    low, high = ratios
    ratio = log_even(RATIO, low, high, 0.93 * low, 1.1 * high, 0.4)
    unknowns = tuple(ratio if unknown.name == RATIO else unknown for unknown in of.unknowns)
    wrong = tuple(Unknown(f"{ERROR} {k}", 0.0, 1.0, -5.0, 5.0, 1.5) for k in range(components))
    return Class(of.name, (*unknowns, *wrong), of.case, of.fields)


BALL = Class("ball", (_D, _DEPTH, _STIFFNESS, *_TISSUE), _ball, _FIELDS)
ELLIPSOID = Class(
    "ellipsoid",
    (
        *BALL.unknowns,
        Unknown(WIDTH, 0.0, _ASPECT_SD, np.log(0.5), np.log(1.9), 0.15),
        Unknown(HEIGHT, 0.0, _ASPECT_SD, np.log(0.5), np.log(1.9), 0.15),
    ),
    _ellipsoid,
    _FIELDS,
)
NONE = Class("none", (_FAT, *_LAYERS), _none, ("t_mm", "gland_ratio", "gland_mm"))
