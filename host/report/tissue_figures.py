"""Figures 6d to 8: the tissue, its mesh, and how it gives way under the probe. Units: mm, kPa."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from palpate.report import style
from palpate.report.items import Beside, Item
from palpate.sim.tissue import Case, Settings
from palpate.sim.tissue.deformation import Pressed, deformation
from palpate.sim.tissue.mesh import FAT, GLAND, TissueMesh, build_mesh

REFERENCE = "d10h08e10f10"
SHOWN_GEOMETRIES = ("d05h15e10f10", REFERENCE, "d20h03e10f10")
SHOWN_POSITIONS_MM = (-28.0, -14.0, -6.0, 0.0)
_RIM = (0, 1, 2, 5, 8, 7, 6, 3)
"""The nodes round a nine-node element."""


def items(*, simulate: bool = True) -> list[Item]:
    """Figures 6d, 7 and 8; without `simulate` Figure 8 is left out (it takes a stroke of its own)."""
    case = Case.from_code(REFERENCE)
    mesh = build_mesh(case, Settings(), -28.0, 0.0)
    out = [
        Item(
            "Figure 6d",
            "Fat over gland over chest wall, a round lump on the border between fat and gland; the probe "
            "presses from above and is stroked along the surface. t = d (h + 1/2). Small elements in a skin "
            "along the surface and round the lump, coarse ones elsewhere.",
            [
                Beside(
                    "reference case",
                    "d = 1.0 cm, h = 0.8, E = 10, F = 1.0",
                    f"{case.code}, t = {case.t_mm:g} mm",
                ),
                Beside("gland", "6 times as stiff as fat", f"{case.gland_ratio:g} times"),
                Beside("unit of force", "not given", f"F = 1.0 is {case.F_N_per_m:g} N per metre of width"),
                Beside("nodes", "about 3000", f"{len(mesh.nodes_mm)}"),
                Beside("elements", "over 1000 quadratic", f"{len(mesh.elements)} with nine nodes each"),
            ],
            lambda: figure_6d(mesh),
        ),
        Item(
            "Figure 7",
            "Three of the thirty geometries, each meshed by the same rule.",
            [Beside("geometries", "three of thirty", ", ".join(SHOWN_GEOMETRIES))],
            figure_7,
        ),
    ]
    if simulate:
        deformed, pressed = deformation(case, SHOWN_POSITIONS_MM)
        strain = max(p.displacement_mm for p in pressed) / case.t_mm
        beside = [Beside("greatest nominal strain", "up to 20 %", f"{100 * strain:.1f} %")]
        caption = (
            "Four positions of one stroke: the deformed tissue with the probe, and the tactile image below."
        )
        out.append(Item("Figure 8", caption, beside, lambda: figure_8(deformed, pressed)))
    return out


def figure_6d(mesh: TissueMesh) -> Figure:
    """The whole mesh, and the part round the lump."""
    figure = style.new(8.4, 4.6)
    whole, near = figure.subplots(2, 1, height_ratios=(1, 1.7))
    for ax in (whole, near):
        draw_mesh(ax, mesh, mesh.nodes_mm)
    near.set(xlim=(-26, 26), ylim=(-15.5, 15), xlabel="mm", ylabel="mm")
    whole.set_ylabel("mm")
    whole.set_title("whole model")
    near.set_title("round the lump")
    return figure


def figure_7() -> Figure:
    """Three geometries to the same scale."""
    figure = style.new(8.4, 2.75)
    axes = figure.subplots(1, 3, sharey=True)
    axes[0].set_ylabel("mm")
    for ax, code in zip(axes, SHOWN_GEOMETRIES):
        case = Case.from_code(code)
        mesh = build_mesh(case, Settings(), -28.0, 0.0)
        draw_mesh(ax, mesh, mesh.nodes_mm)
        ax.set(xlim=(-22, 22), ylim=(-16, 18), xlabel="mm")
        ax.set_title(f"{code}\nt = {case.t_mm:g} mm")
    return figure


def figure_8(mesh: TissueMesh, pressed: list[Pressed]) -> Figure:
    """Deformed meshes above, tactile images below."""
    figure = style.new(9.4, 4.6)
    axes = figure.subplots(2, len(pressed), height_ratios=(1.5, 1), sharey="row")
    for (above, below), state in zip(axes.T, pressed):
        draw_mesh(above, mesh, state.nodes_mm)
        above.add_patch(
            Polygon(
                np.vstack((state.face_mm, state.face_mm[[-1, 0]] + [[0, 9], [0, 9]])),
                fc="#c9d4dc",
                ec=style.SOFT,
                lw=0.8,
            )
        )
        above.set(xlim=(state.position_mm - 17, state.position_mm + 17), ylim=(-15.5, 19))
        above.set_title(f"probe at {state.position_mm:g} mm")
        below.plot(state.sensors_mm, state.image_kPa, "o-", ms=3)
        below.set(xlabel="place on the probe (mm)", ylim=(0, 1.08 * max(p.image_kPa.max() for p in pressed)))
    axes[0, 0].set_ylabel("mm")
    axes[1, 0].set_ylabel("pressure (kPa)")
    return figure


def draw_mesh(ax: Axes, mesh: TissueMesh, nodes_mm: np.ndarray) -> None:
    """Elements in their materials' colours, drawn as pixels inside SVG files (thousands of them)."""
    rims = nodes_mm[mesh.elements[:, _RIM]]
    colors = [style.FAT if m == FAT else style.GLAND if m == GLAND else style.LUMP for m in mesh.material]
    ax.add_collection(
        PolyCollection(list(rims), facecolors=colors, edgecolors="#00000055", linewidths=0.3, rasterized=True)
    )
    ax.set(
        xlim=(nodes_mm[:, 0].min(), nodes_mm[:, 0].max()),
        ylim=(nodes_mm[:, 1].min(), nodes_mm[:, 1].max() + 1),
    )
    ax.set_aspect("equal")
    ax.grid(visible=False)
