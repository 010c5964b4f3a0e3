"""Where the mesh's columns and rows stand. Units: mm, origin in the middle of the lump, y upwards."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.sim.tissue.case import Case
from palpate.sim.tissue.errors import CaseError
from palpate.sim.tissue.layers import rows_through
from palpate.sim.tissue.settings import Settings

LEAST_ROOM_MM = 20.0
"""Between the probe's reach at its outermost positions and the rollers at the sides."""

_HIGHEST_CUT = 0.992
"""How far off its middle, in radii, a border may cut the lump and be followed exactly.

Above, its wedge beside the lump is too thin for elements: from there until it has left the lump by `_CLEAR`
it bends down to this height within the box that holds the lump, a strip of at most .011 of the radius.
"""

_CLEAR = 0.003
_CORNER_SHARE = 0.3
_NEAR_MM = 1.0


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
        Element rows of the box over and under the line in it: the border between fat and gland where that
        meets the lump, or else y = 0.
    in_gland : int
        Element rows of the box that lie in the gland.
    inner, outer : int
        Element rings in the lump, round its core, and in the tissue round it.
    radius : float
        The lump's radius.
    borders : tuple of float
        Heights of the borders between the layers, downwards; the first is that of fat and gland.
    turns : tuple of float
        By which angles the lines from the core to the circle turn upwards: from its lower corner, from the
        middle of its side, where the box's inner line goes on, and from its upper corner.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    box_x: tuple[int, int]
    box_y: tuple[int, int]
    above: int
    below: int
    in_gland: int
    inner: int
    outer: int
    radius: float
    borders: tuple[float, ...]
    turns: tuple[float, float, float]


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
    r, top_mm, border, hx = case.d_mm / 2, case.centre_mm, case.border_mm, settings.hx_mm
    room = case.gland_mm - border
    if r > 0.95 * room:
        raise CaseError(
            f"a lump of {case.d_mm:g} mm does not fit into {room:g} mm over the {case.under_gland}"
        )
    half = r + max(min(0.5 * r, 3.0), 1.2)
    columns = 2 * math.ceil(half / hx)
    half = columns / 2 * hx
    if half + 2 * hx > min(-settings.left_mm, settings.right_mm) / 2:
        raise CaseError(f"a lump of {case.d_mm:g} mm is too wide for the tissue around it")

    skin = skin_rows(case, settings)
    skin_bottom = top_mm - float(skin.sum())
    clear = skin_bottom - r
    top = r + (min(max(0.35 * clear, 0.5), half - r) if clear >= 0.6 else 0.5 * clear)
    bottom = r + min(half - r, 0.5 * (room - r))
    if (1 + _CLEAR) * r < border < top + _NEAR_MM:
        top = border  # the box ends where the fat begins
    if (1 + _CLEAR) * r < -border < bottom + _NEAR_MM:
        bottom = -border
    met = meets(border, r)
    line = border if met else 0.0
    row = settings.row_mm
    above = max(2, math.ceil((top - line) / min(row, max(1.0, case.d_mm / 5))))
    below = max(2, math.ceil((bottom + line) / min(1.2 * row, max(1.2, case.d_mm / 4))))

    under = np.linspace(-room, -bottom, max(1, math.ceil((room - bottom) / settings.gland_row_mm)) + 1)
    under = with_line(under, border)
    under = np.concatenate([rows_through(case.borders_mm[2:], settings.gland_row_mm, -room), under])
    over = with_line(_rows_over_box(top, skin_bottom, float(skin[-1]), row), border)
    rows = [under, np.linspace(-bottom, line, below + 1)[1:], np.linspace(line, top, above + 1)[1:], over[1:]]
    y = np.concatenate([*rows, top_mm - np.cumsum(skin)[-2::-1], [top_mm]])

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
        in_gland=k * (below if met else below + above if border > 0 else 0),
        inner=k * max(1, math.ceil(0.36 * r / max(1.8, case.d_mm / 6))),
        outer=k * max(settings.shells, round((half - r) / 2.0)),
        radius=r,
        borders=case.borders_mm[:-1],
        turns=turns(line / r),
    )


def skin_rows(case: Case, settings: Settings) -> NDArray[np.float64]:
    """Heights of the thin rows under the surface: thinner where there is little fat or a shallow lump."""
    least = min(case.depth_mm, case.t_mm)
    return np.array(settings.skin_mm) * min(1.0, 0.5 * least / sum(settings.skin_mm))


def meets(border: float, radius: float) -> bool:
    """Whether the border between fat and gland, at this height, meets the lump."""
    return abs(border) <= (1 + _CLEAR) * radius


def turns(height: float) -> tuple[float, float, float]:
    """`Grid.turns` for a line that meets the circle at `height`, in radii.

    The corners, at 45 degrees, give way to a line that comes near.
    """
    meeting = math.asin(min(max(height, -_HIGHEST_CUT), _HIGHEST_CUT))
    lower = meeting - _CORNER_SHARE * (math.pi / 2 + meeting)
    upper = meeting + _CORNER_SHARE * (math.pi / 2 - meeting)
    return min(0.0, lower + math.pi / 4), meeting, max(0.0, upper - math.pi / 4)


def with_line(rows: NDArray[np.float64], line: float, least_mm: float = 1e-9) -> NDArray[np.float64]:
    """Rows with a border at `line` if it lies among them, in place of an inner one that is near.

    least_mm: closer to the first or the last of the rows it is no line of its own.
    """
    if not rows[0] + least_mm < line < rows[-1] - least_mm:
        return rows
    if len(rows) > 2:
        k = 1 + int(np.abs(rows[1:-1] - line).argmin())
        if abs(rows[k] - line) < 0.25 * (rows[k + 1] - rows[k - 1]):
            rows = np.delete(rows, k)
    return np.sort(np.append(rows, line))


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
