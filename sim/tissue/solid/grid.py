"""Where the solid mesh's columns, rows and layers stand.

Units: mm. x runs along the stroke, y upwards, z across; the lump's middle is at x = y = 0 and z = its offset
from the stroke's line. "Half" stands for the half model, z >= 0, of a lump on the line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.grid import with_line
from palpate.sim.tissue.layers import rows_through
from palpate.sim.tissue.settings import Settings

Floats = NDArray[np.float64]

THROUGH_MM = 200.0
"""A lump whose half-axis across is longer goes through the tissue: the limit of plane strain."""

_SIDES_MM = (-100.0, 80.0)
_ACROSS_MM = 75.0
_FACE_LINES_MM = (12.5, 17.0, 18.5, 20.0, 21.5)
"""Layers on either side of the stroke's line: contact ends about 19.5 mm out, and nodes there matter most."""

_SKIN_MM = 1.5
_ROW_GROWTH = 2.5
_ROW_MM = 7.0
_LEAST_ROW_MM = 0.1
_GLAND_ROW_MM = 9.0
_FAR_GROWTH = 3.0
_LEAST_GAP_MM = 1.4
_SHELLS_ROUND = 2
"""Of elements between the lump and its box: one alone makes the bump 5 % too high, docs/physics.md."""
_HIGHEST_SPLIT = 0.7
"""Up to this share of the lump's half height a border through it is followed by the mesh."""


@dataclass(frozen=True)
class SolidGrid:
    """Borders of the outer grid, and the box in it that holds the lump.

    Attributes
    ----------
    x, y, z : ndarray
        Borders of columns, rows and layers, ascending.
    box : tuple of (int, int)
        First and last border of the box in x, y and z; none where there is no lump to mesh.
    half_axes : tuple of float
        The lump's, in x, y and z.
    offset : float
        z of the lump's middle.
    borders : tuple of float
        Heights of the borders between the layers, downwards; the first is that of fat and gland.
    split : float
        Height of the row line inside the box: the border's where that passes through the lump, or 0.
    inner, outer : int
        Element shells in the lump, round its core, and in the tissue round it.
    half : bool
        True for the half model.
    through : bool
        True where the lump is so long across that it goes through the whole tissue: no shell ends it.
    """

    x: Floats
    y: Floats
    z: Floats
    box: tuple[tuple[int, int], ...] | None
    half_axes: tuple[float, float, float]
    offset: float
    borders: tuple[float, ...]
    split: float
    inner: int
    outer: int
    half: bool
    through: bool = False


def lay_grid(
    case: Case, settings: Settings, first_mm: float, last_mm: float, follow_border: bool = True
) -> SolidGrid:
    """The grid for strokes whose positions lie between `first_mm` and `last_mm`.

    Parameters
    ----------
    follow_border : bool
        Whether elements follow a border between fat and gland that passes through the lump, as far as they
        can; otherwise it cuts them.

    Raises
    ------
    CaseError
        The lump does not fit.
    """
    along, across, down = case.half_axes_mm
    half = case.offset_mm == 0.0
    through = half and across >= THROUGH_MM
    hx = settings.hx_mm
    count = 2 * math.ceil((along + _margin(along)) / hx)
    box_x = count / 2 * hx
    if box_x + 2 * hx > -_SIDES_MM[0] / 2 or (
        not through and abs(case.offset_mm) + across > 0.6 * _ACROSS_MM
    ):
        raise CaseError(f"{case.code}: the lump is too wide for the tissue around it")
    fine_left = box_x + hx * max(0, math.ceil((case.reach_mm - first_mm - box_x) / hx - 1e-9))
    fine_right = box_x + hx * max(0, math.ceil((case.reach_mm + last_mm - box_x) / hx - 1e-9))
    fine = np.arange(-round(fine_left / hx), round(fine_right / hx) + 1) * hx
    left, right = _far(fine[0], _SIDES_MM[0], 3.0 * hx), _far(fine[-1], _SIDES_MM[1], 3.0 * hx)
    x = np.concatenate([left[:0:-1], fine, right[1:]])
    y, box_y, split = _rows(case, follow_border, settings.all_rows)
    z, box_z = _layers(case.offset_mm, 0.0 if through else across, half, settings.layer_mm)
    if through:
        box_z = (0, len(z) - 1)
    k = settings.refine
    i0 = int(np.searchsorted(x, -box_x - 1e-6))
    spans = ((i0, i0 + count), box_y, box_z)
    return SolidGrid(
        x=_subdivide(x, k),
        y=_subdivide(y, k),
        z=_subdivide(z, k),
        box=tuple((k * a, k * b) for a, b in spans),
        half_axes=(along, down, across),
        offset=case.offset_mm,
        borders=case.borders_mm[:-1],
        split=split,
        inner=k,
        outer=_SHELLS_ROUND * k,
        half=half,
        through=through,
    )


def lay_plain_grid(of: SolidGrid, case: Case, hx: float, layer_mm: float) -> SolidGrid:
    """A quarter of plain tissue under a probe that stands at x = 0, with the rows of another grid and, where
    that is a half, its layers."""
    step = hx * np.arange(math.ceil(case.reach_mm / hx) + 1)
    x = np.concatenate([step, _far(step[-1], _SIDES_MM[1], 3.0 * hx)[1:]])
    z = of.z if of.half else _beyond(0.0, np.array(_FACE_LINES_MM), _far_across(), layer_mm)
    return SolidGrid(x, of.y, z, None, of.half_axes, 0.0, of.borders, 0.0, 0, 0, half=True)


def _margin(radius: float) -> float:
    return max(min(0.5 * radius, 3.0), 1.2)


def _rows(case: Case, follow_border: bool, every: bool) -> tuple[Floats, tuple[int, int], float]:
    """Rows from the chest wall to the skin, the box among them, and the height of the line inside it."""
    radius, surface, depth = case.half_down, case.centre_mm, case.depth_mm
    border, floor = case.borders_mm[:2]
    skin = min(_SKIN_MM, 0.5 * depth)
    clear = depth - skin
    above = min(max(0.35 * clear, 0.5), _margin(radius)) if clear >= 0.6 else 0.5 * clear
    top = radius + above
    bottom = -radius - min(_margin(radius), 0.5 * (-radius - floor))
    if radius < border < surface - skin and border < top + 1.0:
        top = max(border, radius + 0.5 * above)  # the box ends where the fat begins
    if floor < border < -radius and border > bottom - 1.0:
        bottom = min(border, -radius - 0.5 * (-radius - bottom))
    split = border if follow_border and abs(border) <= _HIGHEST_SPLIT * radius else 0.0
    over = with_line(_rows_over(top, surface - skin, skin, every), border, _LEAST_ROW_MM)
    rows = np.linspace(floor, bottom, max(1, math.ceil((bottom - floor) / _GLAND_ROW_MM)) + 1)
    under = with_line(rows, border, _LEAST_ROW_MM)
    under = np.concatenate([rows_through(case.borders_mm[2:], _GLAND_ROW_MM, floor), under])
    y = np.concatenate([under, [split], over, [surface]])
    first = len(under) - 1
    return y, (first, first + 2), split


def _rows_over(bottom: float, top: float, first: float, every: bool) -> Floats:
    """Ascending borders of rows that grow from `first` at `top` down to `bottom`."""
    depth, height, length = [0.0], first, top - bottom
    while depth[-1] < length - 1e-9:
        height = min(_ROW_GROWTH * height, _ROW_MM)
        depth.append(depth[-1] + height)
    if not every and len(depth) > 2 and depth[-1] - length > 0.5 * height:
        depth.pop()
    return top - np.array(depth)[::-1] * (length / depth[-1])


def _layers(offset: float, across: float, half: bool, widest: float) -> tuple[Floats, tuple[int, int]]:
    """Borders across the stroke, and the box's four layers (two in the half model) among them."""
    wanted = np.array(_FACE_LINES_MM)
    margin = min(max(0.4 * across, 1.2), 2.0)
    far = _far_across()
    if half:
        edge = _snapped(across + margin, across, wanted)
        right = _beyond(edge, wanted, far, widest)
        return np.concatenate([[0.0, edge / 2], right]), (0, 2)
    lines = np.concatenate([-wanted[::-1], [-6.0, 0.0, 6.0], wanted])
    high = _snapped(offset + across + margin, offset + across, lines)
    low = -_snapped(-offset + across + margin, -offset + across, -lines[::-1])
    right, left = (
        _beyond(high, lines, far, widest),
        -_beyond(-low, -lines[::-1], far, widest)[::-1],
    )
    inside = [(low + offset) / 2, offset, (offset + high) / 2]
    return np.concatenate([left, inside, right]), (len(left) - 1, len(left) + 3)


def _far_across() -> Floats:
    """Borders beyond the face's edge."""
    return _far(_FACE_LINES_MM[-1], _ACROSS_MM, 9.0)[1:]


def _snapped(edge: float, lump: float, lines: Floats) -> float:
    """The box's edge, moved to a line of the face where one is near but not too near the lump."""
    near = lines[(lines > lump + 1.0) & (np.abs(lines - edge) < 1.6)]
    return float(near[np.abs(near - edge).argmin()]) if len(near) else edge


def _beyond(edge: float, lines: Floats, far: Floats, widest: float) -> Floats:
    """Borders from `edge` on: the lines that are not too near, cut where they are far apart, and the far
    ones."""
    out = [edge]
    for line in [*lines[lines > edge + _LEAST_GAP_MM], *far]:
        gap = line - out[-1]
        if gap < _LEAST_GAP_MM:
            continue
        parts = math.ceil(gap / widest - 0.2) if line <= lines[-1] else 1
        out += list(out[-1] + gap * np.arange(1, parts + 1) / parts)
    return np.array(out)


def _far(start: float, end: float, first: float) -> Floats:
    """Borders from `start` to `end`, in intervals that grow fast from `first`."""
    reach, step, length = [0.0], first, abs(end - start)
    while reach[-1] < length:
        reach.append(reach[-1] + step)
        step *= _FAR_GROWTH
    return start + np.sign(end - start) * np.array(reach) * (length / reach[-1])


def _subdivide(borders: Floats, k: int) -> Floats:
    """Every interval cut into `k` equal ones."""
    cut = borders[:-1, None] + np.diff(borders)[:, None] * (np.arange(k) / k)
    return np.append(cut.ravel(), borders[-1])
