"""Figure 2: a tactile map in two dimensions. Units: mm, kPa."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from palpate.features.map_features import Floats, tactile_map
from palpate.report import style
from palpate.report.items import Beside, Item
from palpate.report.stroke_panels import COLOURS
from palpate.sim.tissue import Case, Settings, SolidStroke, simulate
from palpate.sim.tissue.face_sensors import ACROSS, places_mm

BALL = "d10h08e10f10_ball"


@dataclass(frozen=True)
class Map2D:
    """Pressure (n, columns) at places along (n,) and across (columns,) the stroke; whose it is."""

    along_mm: Floats
    across_mm: Floats
    pressure_kPa: Floats
    whose: str


def item(recording: Path | None, *, simulate: bool) -> Item:
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
    from palpate.report.measured import most_gaussian
    from palpate.stroke.tactile_map import method_2

    stroke, _ = most_gaussian(path)
    position, images = np.asarray(stroke.image_position_mm), stroke.images_kPa()
    columns = [method_2(position, images[:, :, k]) for k in range(images.shape[2])]
    pressure = np.column_stack([p for _, p, _ in columns])
    return Map2D(columns[0][0], places_mm(images.shape[2]), pressure, f"a stroke of {path.name}")
