"""Where the mesh's columns and rows stand. Units: mm, origin in the middle of the lump, y upwards."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.settings import Settings

LEAST_ROOM_MM = 20.0
"""Between the probe's reach at its outermost positions and the rollers at the sides."""


@dataclass(frozen=True)
class Grid:
    """Columns and rows of the outer grid, and the box in it that holds the round lump.

    Attributes
    ----------
    x, y : ndarray
        Positions of the columns' and rows' borders, ascending.
    box_x, box_y : tuple of int
        First and last border of the box.
    above, below : int
        Element rows of the box over and under the border between fat and gland (y = 0).
    inner, outer : int
        Element rings in the lump, round its core, and in the tissue round it.
    radius : float
        The lump's radius.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    box_x: tuple[int, int]
    box_y: tuple[int, int]
    above: int
    below: int
    inner: int
    outer: int
    radius: float


def lay_grid(case: Case, settings: Settings, first_mm: float, last_mm: float) -> Grid:
    """Columns and rows for strokes whose positions lie between `first_mm` and `last_mm`.

    Raises
    ------
    CaseError
        The lump does not fit between the surface and the chest wall, or the probe between the sides.
    """
    margin = case.reach_mm
    if settings.left_mm > first_mm - margin - LEAST_ROOM_MM or settings.right_mm < (
        last_mm + margin + LEAST_ROOM_MM
    ):
        raise CaseError(
            f"a face that reaches {margin:.3g} mm to either side comes too near the tissue's sides at "
            f"{settings.left_mm:g} and {settings.right_mm:g} mm; "
            "move them (left_mm, right_mm) or stroke less far"
        )
    r, t, gland, hx = case.d_mm / 2, case.t_mm, case.gland_mm, settings.hx_mm
    if r > 0.95 * gland:
        raise CaseError(f"a lump of {case.d_mm:g} mm does not fit into {gland:g} mm of gland")
    half = r + max(min(0.5 * r, 3.0), 1.2)
    columns = 2 * math.ceil(half / hx)
    half = columns / 2 * hx
    if half + 2 * hx > min(-settings.left_mm, settings.right_mm) / 2:
        raise CaseError(f"a lump of {case.d_mm:g} mm is too wide for the tissue around it")

    # The skin's thin rows make room where little fat is left over the lump.
    skin = np.array(settings.skin_mm) * min(1.0, 0.5 * case.depth_mm / sum(settings.skin_mm))
    skin_bottom = t - float(skin.sum())
    clear = skin_bottom - r
    top = r + (min(max(0.35 * clear, 0.5), half - r) if clear >= 0.6 else 0.5 * clear)
    bottom = r + min(half - r, 0.5 * (gland - r))
    row = settings.row_mm
    above = max(2, math.ceil(top / min(row, max(1.0, case.d_mm / 5))))
    below = max(2, math.ceil(bottom / min(1.2 * row, max(1.2, case.d_mm / 4))))

    under = np.linspace(-gland, -bottom, max(1, math.ceil((gland - bottom) / settings.gland_row_mm)) + 1)
    over = _rows_over_box(top, skin_bottom, float(skin[-1]), row)
    rows = [under, np.linspace(-bottom, 0.0, below + 1)[1:], np.linspace(0.0, top, above + 1)[1:], over[1:]]
    y = np.concatenate([*rows, t - np.cumsum(skin)[-2::-1], [t]])

    left = -half - hx * np.arange(max(0, round((-first_mm + margin - half) / hx)) + 1)
    right = half + hx * np.arange(max(0, math.ceil((last_mm + margin - half) / hx)) + 1)
    far_left = _graded(left[-1], settings.left_mm, 1.5 * hx)
    far_right = _graded(right[-1], settings.right_mm, 1.5 * hx)
    middle = np.linspace(-half, half, columns + 1)[1:-1]
    x = np.concatenate([far_left[:0:-1], left[::-1], middle, right, far_right[1:]])

    k = settings.refine
    first_column, first_row = len(far_left) + len(left) - 2, len(under) - 1
    return Grid(
        x=_subdivide(x, k),
        y=_subdivide(y, k),
        box_x=(k * first_column, k * (first_column + columns)),
        box_y=(k * first_row, k * (first_row + below + above)),
        above=k * above,
        below=k * below,
        inner=k * max(1, math.ceil(0.36 * r / max(1.8, case.d_mm / 6))),
        outer=k * max(1, round((half - r) / 2.0)),
        radius=r,
    )


def _rows_over_box(bottom: float, top: float, first: float, largest: float) -> NDArray[np.float64]:
    """Ascending borders of rows that grow by 1.5 from `first` at `top` down to `bottom`."""
    depth, height, length = [0.0], first, top - bottom
    while depth[-1] < length - 1e-9:
        height = min(1.5 * height, largest)
        depth.append(depth[-1] + height)
    if len(depth) > 2 and depth[-1] - length > 0.6 * height:
        depth.pop()
    return top - np.array(depth)[::-1] * (length / depth[-1])


def _graded(start: float, end: float, first: float) -> NDArray[np.float64]:
    """Borders from `start` to `end`, in intervals that grow by 1.7 from `first`."""
    reach, step, length = [0.0], first, abs(end - start)
    while reach[-1] < length:
        reach.append(reach[-1] + step)
        step *= 1.7
    return start + np.sign(end - start) * np.array(reach) * (length / reach[-1])


def _subdivide(borders: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """Every interval cut into `k` equal ones."""
    cut = borders[:-1, None] + np.diff(borders)[:, None] * (np.arange(k) / k)
    return np.append(cut.ravel(), borders[-1])
