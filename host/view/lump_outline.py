"""A lump's outline on a picture to take away, as the page draws it (page/outline.js). Units: mm."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import Normal, withStroke

from palpate.wire.cells import PITCH_MM, SHAPE

_EDGE_MM = SHAPE[1] * PITCH_MM / 2
_END_MM = SHAPE[0] * PITCH_MM / 2
_LINE: dict[str, Any] = {
    "color": "white",
    "lw": 1.4,
    "path_effects": [withStroke(linewidth=3, foreground="black", alpha=0.6), Normal()],
}
_SOFT: dict[str, Any] = {"facecolor": "white", "alpha": 0.3, "lw": 0}


def draw_outline(ax: Axes, lump: dict[str, Any], position_mm: float) -> None:
    """Draw what of the lump lies under the face.

    Parameters
    ----------
    ax : Axes
        The tactile image: across from the middle of the face, along upwards.
    lump : dict
        As `FoundLump.as_dict` tells it.
    position_mm : float
        Where the probe was when it felt the image.
    """
    along = lump["along_mm"] - position_mm
    long, low, high = (value / 2 for value in lump["d_mm"])
    if abs(along) - long >= _END_MM:
        return
    ax.autoscale(False)
    dash = "-" if lump["sure"] else (0, (4, 3))
    left, right = _sides(lump)
    if lump["width_mm"] is not None:
        middle = lump["across_mm"][0] if lump["across_mm"] is not None else (left + right) / 2
        wide, wide_low, wide_high = (value / 2 for value in lump["width_mm"])
        t = np.linspace(0, 2 * np.pi, 181)
        ax.plot(middle + wide * np.cos(t), along + long * np.sin(t), ls=dash, **_LINE)
        if lump["sure"]:
            x = np.concatenate([wide_high * np.cos(t), wide_low * np.cos(t[::-1])])
            y = np.concatenate([high * np.sin(t), low * np.sin(t[::-1])])
            ax.fill(middle + x, along + y, **_SOFT)
        return
    for side in (-1, 1):
        ax.plot([left, right], [along + side * long] * 2, ls=dash, **_LINE)
        if lump["sure"]:
            ends = along + side * low, along + side * high
            ax.fill([left, right, right, left], np.repeat(ends, 2), **_SOFT)
    if lump["columns_mm"] is not None:
        for edge in (left, right):
            ax.plot([edge, edge], [along - long, along + long], ls=(0, (1.5, 3)), **_LINE)


def felt_across(lump: dict[str, Any]) -> str:
    """What is known of it across the stroke where no model tells its width."""
    if lump["columns_mm"] is None:
        return "Width not known"
    left, right = lump["columns_mm"]
    return f"Width not known, felt from {left:.1f} to {right:.1f} mm across".replace("-", "\u2212")


def _sides(lump: dict[str, Any]) -> tuple[float, float]:
    return lump["columns_mm"] or (-_EDGE_MM, _EDGE_MM)
