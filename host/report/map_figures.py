"""Figures 9 to 12 and 14: tactile maps, their features, and displacement. Units: mm, kPa."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from host.features import (
    CURVATURE_AT_MM,
    Floats,
    fit_gaussian,
    map_grid_mm,
    peak_jumps,
    peak_trace,
    stroke_features,
    tactile_map,
    whole_stroke,
)
from host.regression.table import REFERENCE_CODE
from host.report import style
from host.report.items import Beside, Item, number
from sim.tissue import Stroke

Strokes = Mapping[str, Stroke]
JUMPING = ("d10h08e10f10", "d10h05e10f10", "d10h03e10f10")

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


def items(strokes: Sequence[Stroke]) -> list[Item]:
    """Figures 9 to 12 and 14 of these strokes; what they lack is said."""
    by_code = {stroke.code: stroke for stroke in strokes}
    if REFERENCE_CODE not in by_code:
        why = f"Needs the reference case {REFERENCE_CODE}: palpate sweep --design thesis --out DIR"
        return [Item(f"Figure {n}", title, missing=why) for n, title in TITLES.items()]
    return [_nine(by_code), _ten(by_code), _eleven(by_code), _twelve(by_code), _fourteen(by_code)]


TITLES = {
    9: "Formation of Tactile Maps from Contact Pressure Data",
    10: "Feature Extraction (Tactile Maps and Tactile Images)",
    11: 'Feature Extraction (Displacement and Pressure "Jumps")',
    12: "The Effects of Input Parameters on Tactile Maps",
    14: "The Effects of Input Parameters on Probe Displacement",
}


def _nine(strokes: Strokes) -> Item:
    stroke = strokes[REFERENCE_CODE]

    def lumpiness(method: int, increment: float) -> str:
        x, p = tactile_map(stroke, method, map_grid_mm(increment))
        fit = fit_gaussian(x, p, centre_mm=0.0)
        rough = np.std(np.diff(p, 2)) / 2.45 if increment == 1.0 else np.std(p - fit.curve(x))
        return f"{1000 * rough:.1f} Pa"

    return Item(
        "Figure 9",
        TITLES[9],
        "The same stroke put together by Method 1 (images set side by side and averaged) and by Method 2 "
        "(the trace of "
        "each point of the probe, interpolated and averaged), at 2 mm and at 1 mm. Method 2 is used from "
        "here on.",
        [
            Beside("Method 1 at 1 mm, point-to-point noise", '"artificial lumpiness"', lumpiness(1, 1.0)),
            Beside("Method 2 at 1 mm, point-to-point noise", "smooth", lumpiness(2, 1.0)),
        ],
        lambda: figure_9(stroke),
    )


def figure_9(stroke: Stroke) -> Figure:
    """Tactile maps by Method 1 and Method 2, at 2 mm and 1 mm."""
    figure = style.new()
    axes = figure.subplots(1, 2, sharey=True)
    for ax, method in zip(axes, (1, 2)):
        for increment, mark in ((2.0, "o"), (1.0, ".")):
            x, p = tactile_map(stroke, method, map_grid_mm(increment))
            ax.plot(x, p, marker=mark, ms=4, lw=0.9, label=f"every {increment:g} mm")
        ax.set(xlabel="place on the tissue (mm)")
        ax.set_title(f"Method {method}")
        ax.legend()
    axes[0].set_ylabel("pressure (kPa)")
    return figure


def _ten(strokes: Strokes) -> Item:
    features = stroke_features(strokes[REFERENCE_CODE])
    return Item(
        "Figure 10",
        TITLES[10],
        "The tactile map is a Gaussian on a base: Base, Amplitude and Stdev. Curvature is the pressure at "
        "the middle of "
        "the probe over the mean of those 8 mm to either side, far from the lump.",
        [
            Beside("Base", "values lost with Appendix A", f"{features.base_kPa:.3f} kPa"),
            Beside("Amplitude", "", f"{features.amp_kPa:.3f} kPa"),
            Beside("Stdev", "", f"{features.stdev_mm:.2f} mm"),
            Beside("Curvature", "slight", number(features.curvature)),
            Beside(
                "map against its Gaussian, rms", '"resembles a Gaussian"', f"{1000 * features.rms_kPa:.1f} Pa"
            ),
        ],
        lambda: figure_10(strokes[REFERENCE_CODE]),
    )


def figure_10(stroke: Stroke) -> Figure:
    """The Gaussian on its base, and the image 28 mm from the lump with its Curvature."""
    figure = style.new()
    left, right = figure.subplots(1, 2)
    x, p = tactile_map(stroke)
    fit = fit_gaussian(x, p, centre_mm=0.0)
    fine = np.linspace(x[0], x[-1], 300)
    left.plot(x, p, "o", ms=3, label="tactile map")
    left.plot(fine, fit.curve(fine), label="Gaussian")
    left.axhline(fit.base_kPa, color=style.SOFT, lw=0.8, ls="--")
    arrow = {"arrowstyle": "<->", "color": style.INK, "shrinkA": 0, "shrinkB": 0}
    left.annotate("", (0, fit.base_kPa), (0, fit.base_kPa + fit.amp_kPa), arrowprops=arrow)
    left.text(-0.9, fit.base_kPa + 0.35 * fit.amp_kPa, "Amp", va="center", ha="right")
    half = fit.base_kPa + fit.amp_kPa * np.exp(-0.5)
    left.annotate("", (0, half), (fit.stdev_mm, half), arrowprops=arrow)
    left.text(fit.stdev_mm + 1, half, "Stdev", va="center")
    left.text(x[0], fit.base_kPa + 0.07 * fit.amp_kPa, "Base", va="bottom")
    left.set(xlabel="place on the tissue (mm)", ylabel="pressure (kPa)")
    left.set_title("tactile map")
    left.legend(loc="upper right")
    right.plot(stroke.sensors_mm, stroke.images_kPa[0], "o-", ms=3)
    for place in (-CURVATURE_AT_MM, 0.0, CURVATURE_AT_MM):
        right.axvline(place, color=style.ORANGE, lw=0.8, ls="--")
    right.set(xlabel="place on the probe (mm)", ylim=(0, None))
    right.set_title(f"tactile image at 28 mm: Curvature {stroke_features(stroke).curvature:.3f}")
    return figure


def _eleven(strokes: Strokes) -> Item:
    features = stroke_features(strokes[REFERENCE_CODE])
    jumps = {code: peak_jumps(strokes[code]) for code in JUMPING if code in strokes}
    return Item(
        "Figure 11",
        TITLES[11],
        "How far the probe sinks in along the stroke, A at 28 mm and B over the lump; and the place of the "
        "greatest "
        "pressure of each image, which jumps as the lump comes under the probe.",
        [
            Beside("A: displacement at 28 mm", "several millimetres", f"{features.D28_mm:.2f} mm"),
            Beside("B: displacement over the lump", "less", f"{features.D0_mm:.2f} mm"),
            Beside(
                "jumps of the peak",
                "in many simulations, no trend",
                f"in {sum(map(bool, jumps.values()))} of {len(jumps)} shown",
            ),
        ],
        lambda: figure_11(strokes),
    )


def figure_11(strokes: Strokes) -> Figure:
    """Probe displacement, and the place of the greatest pressure with its jumps."""
    figure = style.new()
    left, right = figure.subplots(1, 2)
    x, _, displacement = whole_stroke(strokes[REFERENCE_CODE])
    left.plot(x, displacement, ".-")
    for place, name in ((-28.0, "A"), (0.0, "B")):
        depth = float(np.interp(place, x, displacement))
        left.plot(place, depth, "o", color=style.ORANGE)
        left.annotate(name, (place, depth), (4, 6), textcoords="offset points", weight="bold")
    left.set(xlabel="probe position (mm)", ylabel="displacement (mm)")
    left.margins(y=0.12)
    for code in JUMPING:
        if code in strokes:
            spot, pressure = peak_trace(strokes[code])
            right.plot(spot, pressure, ".-", label=f"h = {strokes[code].case.h:g}")
    right.set(xlabel="place of the peak on the tissue (mm)", ylabel="greatest pressure (kPa)")
    right.legend()
    return figure


def _twelve(strokes: Strokes) -> Item:
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
        TITLES[12],
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


def _fourteen(strokes: Strokes) -> Item:
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
        TITLES[14],
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
