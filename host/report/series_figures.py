"""Figures 12 and 14: series of strokes in which one input changes after the other. Units: mm, kPa."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.features.map_features import Floats, stroke_features, tactile_map
from palpate.report import style
from palpate.report.items import Beside, Item
from palpate.sim.tissue import Stroke

Strokes = Mapping[str, Stroke]

GROUPS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("force F", tuple(f"d10h08e10f{f}" for f in ("02", "04", "06", "08", "10"))),
    ("stiffness E", tuple(f"d10h08e{e}f10" for e in ("02", "05", "10", "50", "1K", "NL"))),
    (
        "E and F",
        ("d10h08e1Kf02", "d10h08e05f03", "d10h08e50f04", "d10h08e02f06", "d10h08e05f06", "d10h08e1Kf06"),
    ),
    ("diameter d", tuple(f"d{d}h08e10f10" for d in ("05", "10", "15", "20"))),
    ("depth h", tuple(f"d10h{h}e10f10" for h in ("03", "05", "08", "12", "15"))),
    ("d and h", ("d05h15e10f10", "d05h12e10f10", "d15h05e10f10", "d20h05e10f10", "d20h03e10f10")),
)
"""The six graphs of Figure 12."""


def twelve(strokes: Strokes) -> Item:
    """Figure 12: what each input does to the tactile maps, beside what the thesis says of it."""
    low, high = (stroke_features(strokes[c]) for c in ("d10h08e10f02", "d10h08e10f10")) if {
        "d10h08e10f02", "d10h08e10f10"
    } <= strokes.keys() else (None, None)  # fmt: skip
    beside = []
    if low is not None and high is not None:
        ours = ", ".join(
            f"{name} x {b / a:.2f}"
            for name, a, b in (
                ("Base", low.base_kPa, high.base_kPa),
                ("Amp", low.amp_kPa, high.amp_kPa),
                ("Stdev", low.stdev_mm, high.stdev_mm),
            )
        )
        beside.append(Beside("force from .2 to 1.0", "Base, Amplitude and Stdev increase", ours))
    return Item(
        "Figure 12",
        "Tactile maps as force, stiffness, diameter and depth change, one at a time and together.",
        beside,
        lambda: figure_12(strokes),
    )


def figure_12(strokes: Strokes) -> Figure:
    """Tactile maps in six groups."""
    figure = style.new(9.2, 8.4)
    for ax, (title, codes) in zip(figure.subplots(3, 2).flat, GROUPS):
        _curves(ax, title, strokes, codes, lambda stroke: tactile_map(stroke))
        ax.set(xlabel="place on the tissue (mm)", ylabel="pressure (kPa)")
    return figure


def _curves(
    ax: Axes,
    title: str,
    strokes: Strokes,
    codes: Sequence[str],
    curve: Callable[[Stroke], tuple[Floats, Floats]],
) -> None:
    """One curve for each stroke, from dark to light as its inputs grow; a lump that stiffens is dashed."""
    shown = [strokes[code] for code in codes if code in strokes]
    for stroke, color in zip(shown, style.ramp(len(shown))):
        usual = not stroke.case.nonlinear_lump
        look = {"color": color} if usual else {"color": style.ORANGE, "ls": "--"}
        ax.plot(*curve(stroke), label=_inputs(title, stroke), **look)
    ax.set_title(title)
    style.beside(ax)


def _inputs(title: str, stroke: Stroke) -> str:
    """What sets a curve apart from the others under this title: "E = 2, F = 0.6"."""
    case = stroke.case
    E = "nonlinear" if case.nonlinear_lump else f"E = {case.E_ratio:g}"
    words = {"F": f"F = {case.F_rel:g}", "E": E, "d": f"d = {case.d_mm:g} mm", "h": f"h = {case.h:g}"}
    return ", ".join(words[name] for name in ("d", "h", "E", "F") if name in title.split())


def fourteen(strokes: Strokes) -> Item:
    """Figure 14: what each input does to the displacement, beside what the thesis says of it."""
    beside = []
    small, large = strokes.get("d05h08e10f10"), strokes.get("d20h08e10f10")
    if small is not None and large is not None:
        far = large.displacement_mm[0] / small.displacement_mm[0]
        near = large.displacement_mm[-1] / small.displacement_mm[-1]
        beside.append(
            Beside(
                "d from 5 to 20 mm",
                "grows faster at 28 mm than at 0",
                f"x {far:.2f} at 28 mm, x {near:.2f} at 0",
            )
        )
    soft, hard, both = (strokes.get(f"d10h08e{e}f10") for e in ("02", "10", "NL"))
    if soft is not None and hard is not None and both is not None:
        share = [
            (soft.displacement_mm[i] - both.displacement_mm[i])
            / (soft.displacement_mm[0] - hard.displacement_mm[-1])
            for i in (0, -1)
        ]
        way = (soft.displacement_mm[-1] - both.displacement_mm[-1]) / (
            soft.displacement_mm[-1] - hard.displacement_mm[-1]
        )
        beside.append(
            Beside(
                "nonlinear lump",
                "like E = 2 far away, approaches E = 10 over the lump",
                f"{100 * abs(share[0]):.0f} % off E = 2 at 28 mm; {100 * way:.0f} % of the way to E = 10 at "
                "0",
            )
        )
    return Item(
        "Figure 14",
        "Displacement along the stroke as diameter, depth, stiffness and force change.",
        beside,
        lambda: figure_14(strokes),
    )


def figure_14(strokes: Strokes) -> Figure:
    """Displacement along the stroke as d, h, E and F change."""
    figure = style.new(9.2, 5.8)
    for ax, (title, codes) in zip(figure.subplots(2, 2).flat, [GROUPS[k] for k in (3, 4, 1, 0)]):
        _curves(ax, title, strokes, codes, lambda stroke: (-stroke.positions_mm, stroke.displacement_mm))
        ax.set(xlabel="distance from the lump (mm)", ylabel="displacement (mm)")
    return figure
