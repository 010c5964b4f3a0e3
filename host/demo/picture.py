"""The demo's one picture: tactile map and fit, displacement, estimate beside truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from firmware_py import geometry
from palpate.link.events import Frame, TactileMap

CONTACT_KPA = 0.3
INK, TRUTH, PROBE = "#22303c", "#c8553d", "#1f7a8c"
ROWS = (
    ("t_mm", "fat thickness, mm"),
    ("d_mm", "lump diameter, mm"),
    ("depth_mm", "lump depth, mm"),
    ("h", "depth / diameter"),
    ("E_inv23", "E^(-2/3)"),
    ("F_N_per_m", "force, N/m"),
)


def draw(
    path: Path,
    frames: list[Frame],
    found: TactileMap,
    estimate: dict[str, Any],
    truth: dict[str, float],
    headline: str = "",
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
        The estimate's JSON form.
    truth : dict
        The case's inputs, under the estimate's names.
    headline : str
        The verdict, above everything.
    """
    figure = Figure(
        figsize=(11.5, 6.2), layout=ConstrainedLayoutEngine(w_pad=0.1, h_pad=0.08), facecolor="white"
    )
    grid = figure.add_gridspec(2, 3, width_ratios=(1.05, 1, 1.15))
    image, map_axes = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    image_far, depth = figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[1, 1])
    _images(figure, image, image_far, frames, found)
    _tactile_map(map_axes, found)
    _displacement(depth, frames, found)
    _estimate(figure, grid[:, 2], estimate, truth)
    if headline:
        figure.suptitle(headline, x=0.012, ha="left", fontsize=14, color=INK, weight="bold")
    figure.savefig(path, dpi=130)


def _images(figure: Figure, over: Any, far: Any, frames: list[Frame], found: TactileMap) -> None:
    place = np.array([frame.position_mm for frame in frames]) - found.as_dict()["centre_mm"]
    middle, away = frames[int(np.abs(place).argmin())], frames[int(np.abs(np.abs(place) - 30).argmin())]
    top = max(float(middle.pressure_kPa.max()), 1.0)
    for axes, frame, title in (
        (over, middle, "tactile image over the lump"),
        (far, away, "tactile image beside it"),
    ):
        shown = axes.imshow(frame.pressure_kPa, cmap="cividis", vmin=0, vmax=top, aspect="equal")
        axes.set_title(title, loc="left", fontsize=10, color=INK)
        axes.set(
            xticks=[],
            yticks=[],
            xlabel=f"across the stroke, {geometry.COLUMNS} cells",
            ylabel=f"along, {geometry.ROWS} cells",
        )
    figure.colorbar(shown, ax=[over, far], label="pressure, kPa", shrink=0.7)


def _tactile_map(axes: Any, found: TactileMap) -> None:
    numbers = found.as_dict()
    x = np.array(numbers["x_mm"])
    fine = np.linspace(x[0], x[-1], 400)
    bump = np.exp(-0.5 * ((fine - numbers["centre_mm"]) / numbers["stdev_mm"]) ** 2)
    axes.plot(x, numbers["pressure_kPa"], "o", ms=3.5, color=INK, label="tactile map")
    axes.plot(
        fine, numbers["base_kPa"] + numbers["amplitude_kPa"] * bump, color=PROBE, lw=1.8, label="Gaussian fit"
    )
    axes.set_title("tactile map, worked out on the probe", loc="left", fontsize=10, color=INK)
    axes.set(xlabel="place along the stroke, mm", ylabel="pressure, kPa")
    axes.legend(frameon=False, fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _displacement(axes: Any, frames: list[Frame], found: TactileMap) -> None:
    touching = [frame for frame in frames if frame.pressure_kPa.mean() > CONTACT_KPA]
    place = [frame.position_mm - found.as_dict()["centre_mm"] for frame in touching]
    axes.plot(place, [frame.displacement_mm for frame in touching], ".", ms=4, color=INK)
    axes.set_title("displacement into the tissue", loc="left", fontsize=10, color=INK)
    axes.set(xlabel="probe's place, mm from the lump", ylabel="displacement, mm")
    axes.spines[["top", "right"]].set_visible(False)


def _estimate(figure: Figure, cell: Any, estimate: dict[str, Any], truth: dict[str, float]) -> None:
    level = round(100 * estimate["level"])
    rows = [row for row in ROWS if row[0] in estimate and row[0] in truth]
    panels = cell.subgridspec(len(rows) + 1, 1, height_ratios=[0.5] + [1] * len(rows))
    head = figure.add_subplot(panels[0])
    head.axis("off")
    head.set_title(f"the probe's estimate, with its {level} % interval", loc="left", fontsize=10, color=INK)
    for i, (name, label) in enumerate(rows):
        axes = figure.add_subplot(panels[i + 1])
        value, low, high = (estimate[name][key] for key in ("value", "low", "high"))
        low = max(low, 0.0)  # no quantity here can be negative
        axes.plot([low, high], [0, 0], color=PROBE, lw=6, alpha=0.35, solid_capstyle="butt")
        (said,) = axes.plot(value, 0, "o", color=PROBE, ms=7)
        (true,) = axes.plot(truth[name], 0, "D", color=TRUTH, ms=6, mfc="none", mew=1.8)
        edges = np.array([low, high, value, truth[name]])
        pad = 0.25 * max(np.ptp(edges), 1e-3 * abs(value), 1e-3)
        axes.set(xlim=(max(edges.min() - pad, 0.0), edges.max() + pad), ylim=(-1, 1), yticks=[])
        axes.set_title(f"{label}: {value:.3g}, truth {truth[name]:.3g}", loc="left", fontsize=9, color=INK)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(labelsize=8)
        if i == 0:
            words = ["estimate", "truth"]
            head.legend(
                [said, true], words, loc="upper left", ncols=2, frameon=False, fontsize=8, borderpad=0
            )
