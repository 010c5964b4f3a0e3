"""Figures 2 and 20: measured tactile maps, in two dimensions and with their Gaussian. Units: mm, kPa."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from palpate.features.map_features import Floats, tactile_map
from palpate.report import style
from palpate.report.items import Beside, Item
from palpate.report.measured import RealMap, most_gaussian, recorded_map
from palpate.report.stroke_panels import COLOURS
from palpate.sim.tissue import Case, Settings, SolidStroke, simulate
from palpate.sim.tissue.face_sensors import ACROSS, places_mm
from palpate.stroke.tactile_map import method_2

BALL = "d10h08e10f10_ball"


@dataclass(frozen=True)
class Map2D:
    """Pressure (n, columns) at places along (n,) and across (columns,) the stroke; whose it is."""

    along_mm: Floats
    across_mm: Floats
    pressure_kPa: Floats
    whose: str


def map_2d(recording: Path | None, *, simulate: bool) -> Item:
    """Figure 2 of a recording, or of a simulated ball (ten seconds)."""
    real = recording is not None and recording.suffix == ".mcap"
    if not real and not simulate:
        why = "Needs a recording (--recording FILE.mcap) or a simulation, which was not asked for."
        return Item("Figure 2", missing=why)
    found = recorded_map_2d(recording) if real and recording else ball_map()
    top = np.unravel_index(int(found.pressure_kPa.argmax()), found.pressure_kPa.shape)
    place = f"{found.along_mm[top[0]]:.0f} mm along, {found.across_mm[top[1]]:.0f} mm across"
    return Item(
        "Figure 2",
        f"Pressure on the tissue along and across the stroke, {found.whose}. "
        "A lump, stiffer than what surrounds it, is a rise of pressure in its place.",
        [
            Beside("lump", "localised pressure increase", f"highest {place}"),
            Beside("whose", "a real tumour", found.whose),
        ],
        lambda: figure_2(found),
    )


def figure_2(found: Map2D) -> Figure:
    """Contours of pressure, and the section through the highest point."""
    figure = style.new(8.4, 3.6)
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1))
    shown = left.contourf(found.along_mm, found.across_mm, found.pressure_kPa.T, 16, cmap=COLOURS)
    left.contour(found.along_mm, found.across_mm, found.pressure_kPa.T, 8, colors="white", linewidths=0.4)
    figure.colorbar(shown, ax=left, label="kPa")
    left.set(xlabel="along the stroke (mm)", ylabel="across (mm)", aspect="equal")
    left.set_title("tactile map")
    left.grid(visible=False)
    column = int(found.pressure_kPa.max(0).argmax())
    left.axhline(found.across_mm[column], color=style.ORANGE, lw=1, ls="--")
    right.plot(found.along_mm, found.pressure_kPa[:, column], color=style.ORANGE)
    right.set(xlabel="along the stroke (mm)", ylabel="pressure (kPa)")
    right.set_title("along the dashed line")
    return figure


def ball_map() -> Map2D:
    """The map of a ball under the probe's whole face, from a simulated stroke in three dimensions."""
    stroke = simulate(
        Case.from_code(BALL), Settings(hx_mm=4.0, increment_mm=4.0)
    )  # the map's peak within 1.5 %
    assert isinstance(stroke, SolidStroke)
    columns = [tactile_map(replace(stroke, images_kPa=stroke.images_kPa[:, :, k])) for k in range(ACROSS)]
    pressure = np.column_stack([p for _, p in columns])
    return Map2D(columns[0][0], places_mm(ACROSS), pressure, f"a simulated ball ({BALL})")


def recorded_map_2d(path: Path) -> Map2D:
    """The map of a recording's most Gaussian stroke, every column of sensors by itself."""
    stroke, _ = most_gaussian(path)
    position, images = np.asarray(stroke.image_position_mm), stroke.images_kPa()
    columns = [method_2(position, images[:, :, k]) for k in range(images.shape[2])]
    pressure = np.column_stack([p for _, p, _ in columns])
    return Map2D(columns[0][0], places_mm(images.shape[2]), pressure, f"a stroke of {path.name}")


def gaussian(recording: Path | None) -> Item:
    """Figure 20 of a recording (.mcap: the stroke whose map is most like a Gaussian) or a table (.csv:
    place in mm, kPa)."""
    if recording is None:
        why = "Needs a recording (.mcap) or a table (.csv: place in mm, pressure in kPa): --recording FILE."
        return Item("Figure 20", missing=why)
    found = recorded_map(recording)
    fit = found.fit
    return Item(
        "Figure 20",
        f"The tactile map of {recording.name} (circles) with the Gaussian on its base, and what is left "
        "over.",
        [
            Beside("difference between map and Gaussian", "very little", f"R2 {found.r2:.4f}"),
            Beside("skewness, of lumps that are no spheres", "slightly skewed", f"{fit.skewness:+.2f}"),
            Beside(
                "Base, Amp, Stdev",
                "can be assigned",
                f"{fit.base_kPa:.3f} kPa, {fit.amp_kPa:.3f} kPa, {fit.stdev_mm:.2f} mm",
            ),
        ],
        lambda: figure_20(found),
    )


def figure_20(found: RealMap) -> Figure:
    """Map, Gaussian and residual."""
    figure = style.new(8.4, 4.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    fine = np.linspace(found.x_mm[0], found.x_mm[-1], 300)
    above.plot(found.x_mm, found.pressure_kPa, "o", mfc="none", label="measured")
    above.plot(fine, found.fit.curve(fine), label="Gaussian")
    above.set_ylabel("pressure (kPa)")
    above.legend()
    below.axhline(0, color=style.SOFT, lw=0.8)
    below.plot(found.x_mm, found.residual_kPa, ".-", ms=3, lw=0.8)
    below.set(xlabel="place on the tissue (mm)", ylabel="left over (kPa)")
    return figure
