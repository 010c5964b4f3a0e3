"""Figures 9 to 11, and with `series_figures` 12 and 14: tactile maps and their features. Units: mm, kPa."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from palpate.features.map_features import (
    CURVATURE_AT_MM,
    fit_gaussian,
    map_grid_mm,
    peak_jumps,
    peak_trace,
    stroke_features,
    tactile_map,
    whole_stroke,
)
from palpate.learn.table import REFERENCE_CODE
from palpate.report import series_figures, style
from palpate.report.items import Beside, Item, lacking, number
from palpate.sim.tissue import Stroke

Strokes = Mapping[str, Stroke]
JUMPING = ("d10h08e10f10", "d10h05e10f10", "d10h03e10f10")


def items(strokes: Sequence[Stroke]) -> list[Item]:
    """Figures 9 to 12 and 14 of these strokes; each says what it lacks."""
    by_code = {stroke.code: stroke for stroke in strokes}
    if REFERENCE_CODE not in by_code:
        why = f"Needs the reference case {REFERENCE_CODE}: palpate sweep --design thesis --out DIR"
        return lacking([f"Figure {n}" for n in (9, 10, 11, 12, 14)], why)
    first = [_nine(by_code), _ten(by_code), _eleven(by_code)]
    return [*first, series_figures.twelve(by_code), series_figures.fourteen(by_code)]


def _nine(strokes: Strokes) -> Item:
    stroke = strokes[REFERENCE_CODE]

    def lumpiness(method: int, increment: float) -> str:
        x, p = tactile_map(stroke, method, map_grid_mm(increment))
        fit = fit_gaussian(x, p, centre_mm=0.0)
        rough = np.std(np.diff(p, 2)) / 2.45 if increment == 1.0 else np.std(p - fit.curve(x))
        return f"{1000 * rough:.1f} Pa"

    return Item(
        "Figure 9",
        "The same stroke put together by Method 1 (images set side by side and averaged) and by Method 2 "
        "(the trace of each point of the probe, interpolated and averaged), at 2 mm and at 1 mm. Method 2 is "
        "used from here on.",
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
        "The tactile map is a Gaussian on a base: Base, Amplitude and Stdev. Curvature is the pressure at "
        "the middle of the probe over the mean of those 8 mm to either side, far from the lump.",
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
        "How far the probe sinks in along the stroke, A at 28 mm and B over the lump; and the place of the "
        "greatest pressure of each image, which jumps as the lump comes under the probe.",
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
