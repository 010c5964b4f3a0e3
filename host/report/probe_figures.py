"""Figures 1 and 2: the probe and how its images become a map, and a map in two dimensions. Units: mm, kPa."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

from palpate.features.map_features import Floats, tactile_map
from palpate.regression.table import REFERENCE_CODE
from palpate.report import style
from palpate.report.items import Beside, Item
from palpate.report.stroke_panels import COLOURS
from palpate.sim.tissue import Case, Settings, SolidStroke, Stroke, simulate
from palpate.sim.tissue.face_sensors import ACROSS, ALONG, PITCH_MM, places_mm
from palpate.sim.tissue.probe_shape import ProbeShape

TITLES = {
    1: "The Tactile Probe and the Formation of Tactile Maps",
    2: "A Two-Dimensional Tactile Map of a Real Tumor",
}
BALL = "d10h08e10f10_ball"
SHOWN_MM = (-28.0, -14.0, 0.0)


@dataclass(frozen=True)
class Map2D:
    """Pressure (n, columns) at places along (n,) and across (columns,) the stroke; whose it is."""

    along_mm: Floats
    across_mm: Floats
    pressure_kPa: Floats
    whose: str


def items(strokes: Sequence[Stroke], recording: Path | None, *, simulate: bool) -> list[Item]:
    """Figure 1 of the reference stroke; Figure 2 of a recording, or of a simulated ball (ten seconds)."""
    return [_one({stroke.code: stroke for stroke in strokes}), _two(recording, simulate)]


def _one(strokes: Mapping[str, Stroke]) -> Item:
    if REFERENCE_CODE not in strokes:
        why = f"Needs the reference case {REFERENCE_CODE}: palpate sweep --design thesis --out DIR"
        return Item("Figure 1", TITLES[1], missing=why)
    size = f"{ALONG} x {ACROSS}, {PITCH_MM:g} mm apart"
    return Item(
        "Figure 1",
        TITLES[1],
        "a: the array of pressure sensors, to scale, with one tactile image (in plane strain every column "
        "is alike). b: the probe's place is known at every instant, so the images can be laid on the tissue "
        "where they were felt; their averages are the tactile map.",
        [
            Beside("pressure sensors", "16 x 26, 1.5 mm apart", size),
            Beside(
                "place of the probe", "magnetic tracker", "known exactly; an emulated probe adds its error"
            ),
        ],
        lambda: figure_1(strokes[REFERENCE_CODE]),
    )


def figure_1(stroke: Stroke) -> Figure:
    """The array with an image on it; the probe at three places, its images there, and the map of all."""
    figure = style.new(9.4, 4.4)
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(1, 1.8))[0]
    _array(left.subplots(), stroke)
    above, below = right.subplots(2, 1, sharex=True, height_ratios=(1, 1.1))
    _strokes_way(above, stroke)
    x, p = tactile_map(stroke)
    for place, color in zip(SHOWN_MM, style.ramp(len(SHOWN_MM))):
        at = int(np.argmin(np.abs(stroke.positions_mm - place)))
        below.plot(
            place + stroke.sensors_mm, stroke.images_kPa[at], "o-", ms=2.5, lw=1, color=color,
            label=f"image at {place:g} mm",
        )  # fmt: skip
    below.plot(x, p, color=style.ORANGE, lw=2, label="tactile map")
    below.set(xlabel="place on the tissue (mm)", ylabel="pressure (kPa)", xlim=(-44, 34), ylim=(0, 7.9))
    below.legend(loc="upper left", ncols=2)
    return figure


def _array(ax: Axes, stroke: Stroke) -> None:
    image = np.repeat(stroke.images_kPa[-1][:, None], ACROSS, axis=1)
    edges = [PITCH_MM * (np.arange(n + 1) - n / 2) for n in (ACROSS, ALONG)]
    shown = ax.pcolormesh(*edges, image, cmap=COLOURS, vmin=0, edgecolors="white", lw=0.4)
    ax.figure.colorbar(shown, ax=ax, orientation="horizontal", label="pressure (kPa)", shrink=0.8)
    ax.annotate(
        "", (22.5, 9), (22.5, -9), arrowprops={"arrowstyle": "-|>", "color": style.INK, "lw": 1.5},
        annotation_clip=False,
    )  # fmt: skip
    ax.text(23.4, 0, "stroke", rotation=90, va="center")
    ax.set(xlabel="across (mm)", ylabel="along (mm)", aspect="equal", xlim=(-20, 26))
    ax.set_title(f"a: {ALONG} x {ACROSS} sensors")
    ax.grid(visible=False)


def _strokes_way(ax: Axes, stroke: Stroke) -> None:
    """The tissue in section, and the probe at the places of the images below."""
    case = stroke.case
    ax.add_patch(Rectangle((-60, 0), 120, case.t_mm, fc=style.FAT, ec="none"))
    ax.add_patch(Rectangle((-60, -8), 120, 8, fc=style.GLAND, ec="none"))
    ax.add_patch(Circle((0, 0), case.d_mm / 2, fc=style.LUMP, ec="white", lw=1))
    shape = ProbeShape(case.probe_radius_mm, case.face_half_mm, case.fillet_per_mm2)
    s = np.linspace(-13.5, 13.5, 81)
    for place, color in zip(SHOWN_MM, style.ramp(len(SHOWN_MM))):
        at = int(np.argmin(np.abs(stroke.positions_mm - place)))
        face = case.t_mm - stroke.displacement_mm[at] + shape.height(s)[0]
        outline = np.vstack((np.column_stack((place + s, face)), [[place + 9, 24], [place - 9, 24]]))
        ax.add_patch(Polygon(outline, fc="#c9d4dccc", ec=color, lw=1.5))
    ax.annotate("", (24, 20), (14, 20), arrowprops={"arrowstyle": "-|>", "color": style.INK, "lw": 1.5})
    ax.text(25, 20, "stroke", va="center")
    ax.set(ylim=(-8, 25), ylabel="height (mm)")
    ax.set_title("b: from images to a map")
    ax.grid(visible=False)


def _two(recording: Path | None, simulated: bool) -> Item:
    real = recording is not None and recording.suffix == ".mcap"
    if not real and not simulated:
        why = "Needs a recording (--recording FILE.mcap) or a simulation, which was not asked for."
        return Item("Figure 2", TITLES[2], missing=why)
    found = recorded_map_2d(recording) if real and recording else ball_map()
    top = np.unravel_index(int(found.pressure_kPa.argmax()), found.pressure_kPa.shape)
    place = f"{found.along_mm[top[0]]:.0f} mm along, {found.across_mm[top[1]]:.0f} mm across"
    return Item(
        "Figure 2",
        TITLES[2],
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
    from palpate.view.tactile_map import method_2

    stroke, _ = most_gaussian(path)
    position, images = np.asarray(stroke.image_position_mm), stroke.images_kPa()
    columns = [method_2(position, images[:, :, k]) for k in range(images.shape[2])]
    pressure = np.column_stack([p for _, p, _ in columns])
    return Map2D(columns[0][0], places_mm(images.shape[2]), pressure, f"a stroke of {path.name}")
