"""One look for all figures."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK = "#1d2b36"
SOFT = "#5b6b78"
BAND = "#e6ebef"
BLUE = "#2366a8"
ORANGE = "#c8641b"
TEAL = "#0b7a75"
COLORS = (BLUE, ORANGE, TEAL, "#8b3a62", "#7a8b1f", "#4b4fa3", "#b03a2e")
FAT, GLAND, LUMP = "#f4dfb5", "#e5aa9a", "#a4473f"

_RC: dict[Any, Any] = {
    "figure.dpi": 100,
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=COLORS),
    "grid.color": BAND,
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "lines.linewidth": 1.5,
    "lines.markersize": 4,
    "text.color": INK,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "svg.hashsalt": "palpate",
    "svg.fonttype": "none",
}


_POWER = re.compile(r"\^(\(-?\d+/\d+\)|-?\d+/\d+|-?\d+(?:\.\d+)?|[A-Z])|\bR2\b")


def ramp(n: int) -> list[tuple[float, float, float, float]]:
    """Colours for `n` curves of a growing quantity: one even scale, dark to light."""
    return [mpl.colormaps["viridis"](v) for v in np.linspace(0.0, 0.82, n)]


def beside(ax: Axes) -> None:
    """The legend to the right of the axes, where it hides no curve."""
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), borderaxespad=0.3, handlelength=1.4)


def powers(text: str) -> str:
    """`E^-2/3` and `R2` with their exponents raised, as matplotlib writes them."""
    return _POWER.sub(lambda m: f"$^{{{m[1].strip('()')}}}$" if m[1] else "R$^2$", text)


def powers_html(text: str) -> str:
    """The same for HTML; `text` must be escaped already."""
    return _POWER.sub(
        lambda m: f"<sup>{m[1].strip('()').replace('-', '&minus;')}</sup>" if m[1] else "R<sup>2</sup>", text
    )


@contextmanager
def look() -> Iterator[None]:
    """Figures made and saved inside have the report's look."""
    with mpl.rc_context(_RC):
        yield


def new(width: float = 8.4, height: float = 3.2) -> Figure:
    """A figure, inches."""
    return Figure(figsize=(width, height), layout="constrained")
