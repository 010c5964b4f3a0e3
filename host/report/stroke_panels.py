"""Panels of one stroke, drawn alike for `simulate --out`, the demo and the page's export. Units: mm, kPa."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from palpate.report import style

COLOURS = "viridis"
"""As the page has them, unless its reader chooses others."""

Extent = tuple[float, float, float, float]


def tactile_image(ax: Axes, pressure_kPa: ArrayLike, extent: Extent, top_kPa: float, title: str) -> Any:
    """One frame, the stroke running upwards; returns what a colour bar is made for.

    Parameters
    ----------
    pressure_kPa : (along, across)
    extent : left, right, bottom, top
    top_kPa : the scale's upper end; the lower is 0
    """
    shown = ax.imshow(
        np.asarray(pressure_kPa), cmap=COLOURS, vmin=0.0, vmax=top_kPa, extent=extent, origin="lower"
    )
    ax.set(xlabel="across (mm)", ylabel="along (mm)", title=title)
    ax.grid(False)
    return shown


def tactile_map(
    ax: Axes, x_mm: ArrayLike, pressure_kPa: ArrayLike, fit: tuple[ArrayLike, ArrayLike] | None
) -> None:
    """The map's points and, if there is one, its Gaussian as a curve (x, p)."""
    ax.plot(x_mm, pressure_kPa, "o", ms=3, color=style.BLUE, label="tactile map")
    if fit is not None:
        ax.plot(*fit, color=style.ORANGE, label="Gaussian fit")
    ax.set(xlabel="place on the tissue (mm)", ylabel="kPa", title="Tactile map")
    ax.legend(loc="upper right")


def displacement(ax: Axes, position_mm: ArrayLike, displacement_mm: ArrayLike) -> None:
    """How deep the probe sinks along its path."""
    ax.plot(position_mm, displacement_mm, ".-", ms=3, lw=0.8, color=style.BLUE)
    ax.set(xlabel="position of the probe (mm)", ylabel="mm", title="Displacement")
