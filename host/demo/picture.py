"""The demo's one picture: tactile images, map and fit, displacement, estimate beside truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from palpate.demo.result import shown
from palpate.features.gaussian import bump
from palpate.report import stroke_panels, style
from palpate.wire.cells import PITCH_MM, SHAPE
from palpate.wire.events import Frame, TactileMap

CONTACT_KPA = 0.3
ROWS = (
    ("d_mm", "diameter d", "mm"),
    ("depth_mm", "depth", "mm"),
    ("h", "depth h", "diameters"),
    ("E_inv23", "stiffness E^-2/3", ""),
    ("t_mm", "fat thickness t", "mm"),
    ("E_fat_kPa", "fat's stiffness", "kPa"),
    ("F_N_per_m", "force F", "N/m"),
    ("width_mm", "width across (host)", "mm"),
    ("place_mm", "place across (host)", "mm"),
)


def draw(
    path: Path,
    frames: list[Frame],
    found: TactileMap,
    estimate: dict[str, Any],
    truth: dict[str, float],
    headline: str = "",
    narrow: bool = False,
) -> None:
    """Draw one stroke as the probe saw it and write it to `path` (suffix chooses the format).

    Parameters
    ----------
    path : Path
        A .png or .svg.
    frames : list of Frame
        The stroke's frames, in order.
    found : TactileMap
        The probe's own tactile map and Gaussian fit.
    estimate : dict
        The estimate's JSON form, with what the host adds across the stroke.
    truth : dict
        The case's inputs, under the estimate's names.
    headline : str
        The verdict, above everything.
    narrow : bool
        All panels in one column, for a phone.
    """
    with style.look():
        size = (3.7, 15.0) if narrow else (11.5, 6.9)
        w_pad, h_pad = (0.1, 0.08) if narrow else (None, None)
        figure = Figure(
            figsize=size, layout=ConstrainedLayoutEngine(w_pad=w_pad, h_pad=h_pad), facecolor="white"
        )
        if headline:
            figure.suptitle(headline, x=0.01, ha="left", fontsize=14, weight="bold")
        parts: Any = (
            figure.subfigures(3, 1, height_ratios=(1, 1, 1.6))
            if narrow
            else figure.subfigures(1, 3, width_ratios=(1.05, 1, 1), wspace=0.04)
        )
        images, traces, estimates = parts
        _images(images, frames, found)
        above, below = traces.subplots(2, 1)
        _tactile_map(above, found)
        _displacement(below, frames, found)
        _estimate(estimates, estimate, truth)
        figure.savefig(path, dpi=220 if narrow else 130)


def _images(figure: SubFigure, frames: list[Frame], found: TactileMap) -> None:
    place = np.array([frame.position_mm for frame in frames]) - found.as_dict()["centre_mm"]
    over, beside = frames[int(np.abs(place).argmin())], frames[int(np.abs(np.abs(place) - 30).argmin())]
    top = max(float(over.pressure_kPa.max()), 1.0)
    half = SHAPE[1] * PITCH_MM / 2, SHAPE[0] * PITCH_MM / 2
    axes = figure.subplots(2, 1, sharex=True)
    for ax, frame, title in zip(axes, (over, beside), ("Over the lump", "Beside it")):
        extent = -half[0], half[0], -half[1], half[1]
        shown = stroke_panels.tactile_image(ax, frame.pressure_kPa, extent, top, title)
    axes[0].set_xlabel("")
    figure.colorbar(shown, ax=list(axes), label="kPa", shrink=0.6, aspect=30)


def _tactile_map(ax: Axes, found: TactileMap) -> None:
    told = found.as_dict()
    fine = np.linspace(told["x_mm"][0], told["x_mm"][-1], 400)
    curve = bump(fine, told["base_kPa"], told["amplitude_kPa"], told["centre_mm"], told["stdev_mm"])
    stroke_panels.tactile_map(ax, told["x_mm"], told["pressure_kPa"], (fine, curve))
    ax.set_title("Tactile map, by the probe")


def _displacement(ax: Axes, frames: list[Frame], found: TactileMap) -> None:
    touching = [frame for frame in frames if frame.pressure_kPa.mean() > CONTACT_KPA]
    place = [frame.position_mm for frame in touching]
    stroke_panels.displacement(ax, place, [frame.displacement_mm for frame in touching])


def _estimate(figure: SubFigure, estimate: dict[str, Any], truth: dict[str, float]) -> None:
    level = round(100 * estimate["level"])
    rows = [row for row in ROWS if estimate.get(row[0]) is not None and row[0] in truth]
    axes = np.atleast_1d(figure.subplots(len(rows), 1))
    for ax, (name, label, unit) in zip(axes, rows):
        said = estimate[name]
        value, low, high = shown(name, (said["value"], said["low"], said["high"]))
        ax.plot([low, high], [0, 0], color=style.TEAL, lw=6, alpha=0.3, solid_capstyle="butt",
                label=f"{level} % interval")  # fmt: skip
        ax.plot(value, 0, "o", color=style.TEAL, ms=7, label="estimate")
        ax.plot(truth[name], 0, "D", color=style.ORANGE, ms=6, mfc="none", mew=1.8, label="truth")
        edges = np.array([low, high, value, truth[name]])
        pad = 0.25 * max(np.ptp(edges), 1e-3 * abs(value), 1e-3)
        left = edges.min() - pad if name == "place_mm" else max(edges.min() - pad, 0.0)
        ax.set(xlim=(left, edges.max() + pad), ylim=(-1, 1), yticks=[])
        words = f"{label}: {value:.3g} {unit}".rstrip()
        ax.set_title(style.powers(f"{words}, truth {truth[name]:.3g}"), weight="normal")
        ax.spines["left"].set_visible(False)
        ax.grid(False)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=3)
