"""The thesis' figures from its runs: each function draws one and returns the figure."""

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
    peak_trace,
    stroke_features,
    tactile_map,
    whole_stroke,
)
from host.regression.strain import StrainForce, curves_by
from host.regression.table import REFERENCE_CODE, SHOWN, TARGETS, target_values
from host.regression.thesis import ThesisFit
from sim.tissue import Stroke

Strokes = Mapping[str, Stroke]

_PANELS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("force F", tuple(f"d10h08e10f{f}" for f in ("02", "04", "06", "08", "10"))),
    ("stiffness E", tuple(f"d10h08e{e}f10" for e in ("02", "05", "10", "50", "1K", "NL"))),
    (
        "E and F",
        ("d10h08e02f06", "d10h08e05f03", "d10h08e05f06", "d10h08e1Kf02", "d10h08e1Kf06", "d10h08e50f04"),
    ),
    ("diameter d", tuple(f"d{d}h08e10f10" for d in ("05", "10", "15", "20"))),
    ("depth h", tuple(f"d10h{h}e10f10" for h in ("03", "05", "08", "12", "15"))),
    ("d and h", ("d05h15e10f10", "d05h12e10f10", "d15h05e10f10", "d20h05e10f10", "d20h03e10f10")),
)


def figure_9(strokes: Strokes) -> Figure:
    """Tactile maps by Method 1 and Method 2, at 2 mm and 1 mm."""
    stroke = strokes[REFERENCE_CODE]
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    for axes, method in zip(figure.subplots(1, 2, sharey=True), (1, 2)):
        for increment, line in ((2.0, "o-"), (1.0, ".-")):
            x, p = tactile_map(stroke, method, map_grid_mm(increment))
            axes.plot(x, p, line, ms=3, lw=0.8, label=f"{increment:g} mm")
        axes.set(title=f"Method {method}", xlabel="place on the skin, mm")
        axes.legend()
    figure.axes[0].set_ylabel("pressure, kPa")
    return figure


def figure_10(strokes: Strokes) -> Figure:
    """Features: the Gaussian on its base, and the image 28 mm from the lump with its Curvature."""
    stroke = strokes[REFERENCE_CODE]
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    x, p = tactile_map(stroke)
    fit = fit_gaussian(x, p, centre_mm=0.0)
    left.plot(x, p, "o", ms=3, label="tactile map")
    left.plot(
        x,
        fit.curve(x),
        label=f"Base {fit.base_kPa:.2f}, Amp {fit.amp_kPa:.2f} kPa, Stdev {fit.stdev_mm:.2f} mm",
    )
    left.set(xlabel="place on the skin, mm", ylabel="pressure, kPa", title="tactile map")
    left.legend(fontsize=7)
    right.plot(stroke.sensors_mm, stroke.images_kPa[0], "o-", ms=3)
    for place in (-CURVATURE_AT_MM, 0.0, CURVATURE_AT_MM):
        right.axvline(place, lw=0.5, color="grey")
    curve = stroke_features(stroke).curvature
    right.set(xlabel="place on the probe, mm", title=f"image at 28 mm: Curvature {curve:.3f}")
    return figure


def figure_11(strokes: Strokes) -> Figure:
    """Probe displacement, and the place of the greatest pressure with its jumps."""
    stroke = strokes[REFERENCE_CODE]
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    x, _, displacement = whole_stroke(stroke)
    left.plot(x, displacement, ".-")
    left.set(xlabel="probe position, mm", ylabel="displacement, mm", title="A: at 28 mm, B: over the lump")
    for name in (REFERENCE_CODE, "d10h05e10f10", "d10h03e10f10"):
        place, pressure = peak_trace(strokes[name])
        right.plot(place, pressure, ".-", label=name)
    right.set(xlabel="place of the peak on the skin, mm", ylabel="greatest pressure, kPa")
    right.legend(fontsize=7)
    return figure


def figure_12(strokes: Strokes) -> Figure:
    """Tactile maps as the inputs change, in six groups."""
    figure = Figure(figsize=(8, 9), layout="constrained")
    for axes, (title, codes) in zip(figure.subplots(3, 2).flat, _PANELS):
        for code in codes:
            axes.plot(*tactile_map(strokes[code]), lw=1, label=code)
        axes.set(title=title, xlabel="place on the skin, mm", ylabel="kPa")
        axes.legend(fontsize=6)
    return figure


def figure_13(fit: ThesisFit) -> Figure:
    """Each output against one input, with its curve."""
    figure = Figure(figsize=(9, 9), layout="constrained")
    for axes, curve in zip(figure.subplots(4, 3).flat, fit.curves):
        x = np.geomspace(curve.x.min(), curve.x.max(), 80)
        axes.plot(curve.x, curve.y, "o", ms=4)
        axes.plot(x, curve(x), lw=1)
        if curve.input == "E_ratio":
            axes.set_xscale("log")
        axes.set_title(f"{curve.text()}   R2 {curve.r2:.3f}", fontsize=8)
    return figure


def figure_14(strokes: Strokes) -> Figure:
    """Displacement along the stroke as d, h, E and F change."""
    figure = Figure(figsize=(8, 6.5), layout="constrained")
    panels = [_PANELS[k] for k in (3, 4, 1, 0)]
    for axes, (title, codes) in zip(figure.subplots(2, 2).flat, panels):
        for code in codes:
            stroke = strokes[code]
            axes.plot(-stroke.positions_mm, stroke.displacement_mm, lw=1, label=code)
        axes.set(title=title, xlabel="distance from the lump, mm", ylabel="displacement, mm")
        axes.legend(fontsize=6)
    return figure


def _strain_force_axes(axes: Axes, curves: Sequence[StrainForce], title: str) -> None:
    for curve in curves:
        s = np.linspace(0, curve.strain.max(), 60)
        line = axes.plot(s, curve(s), lw=1, label=f"{curve.label}: {curve.text()}")[0]
        axes.plot(curve.strain, curve.force, "o", ms=4, color=line.get_color())
    axes.set(title=title, xlabel="nominal strain over the lump", ylabel="F")
    axes.legend(fontsize=6)


def figure_15(fit: ThesisFit) -> Figure:
    """Strain-force curves A S^B for each stiffness."""
    figure = Figure(figsize=(6, 4), layout="constrained")
    _strain_force_axes(figure.subplots(), fit.strain_force, "different E")
    return figure


def figure_16(one_factor: Sequence[Stroke]) -> Figure:
    """Strain-force curves for different d and h; needs the one-factor sweep, which has five forces of each."""
    from host.regression.runs import features_table

    table = features_table(one_factor)
    table = table[table["linear"] & (table["E_ratio"] == 10)]
    figure = Figure(figsize=(9, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    _strain_force_axes(left, curves_by(table[table["h"] == 0.8], ("d_mm",)), "different d")
    _strain_force_axes(right, curves_by(table[table["d_mm"] == 10], ("h",)), "different h")
    return figure


def figure_17(fit: ThesisFit) -> Figure:
    """Forward model: predicted against actual."""
    from host.regression.forward import OUTPUT_NAMES

    figure = Figure(figsize=(8, 5.5), layout="constrained")
    for axes, (name, equation) in zip(figure.subplots(2, 3).flat, fit.forward.items()):
        _diagonal(
            axes, equation.actual, equation.predicted, f"{OUTPUT_NAMES[name]}  R2 {equation.r2_value:.4f}"
        )
    return figure


def figure_18(fit: ThesisFit) -> Figure:
    """Inverse models, pressure only: direct equations in sample and left out, inverted model left out."""
    return _inverse(fit, False)


def figure_19(fit: ThesisFit) -> Figure:
    """Inverse models, pressure and displacement."""
    return _inverse(fit, True)


def _inverse(fit: ThesisFit, displacement: bool) -> Figure:
    figure = Figure(figsize=(9, 6), layout="constrained")
    kind = "displacement" if displacement else "pressure"
    truth = target_values(fit.table)
    for axes, target in zip(figure.subplots(2, 3).flat, TARGETS):
        entry = fit.entry(target, "all", displacement)
        runs = entry.direct.runs
        title = f"{SHOWN[target]}: in {entry.direct.r2_in:.3f}, left out {entry.direct.r2_loo:.3f}"
        _diagonal(axes, runs["truth"].to_numpy(), runs["estimate"].to_numpy(), title)
        axes.plot(runs["truth"], runs["loo"], "x", ms=4, label="left out")
        inverted = fit.inverted[f"{kind}_loo"][target]
        axes.plot(truth[target], inverted, "+", ms=5, label=f"inverted, left out ({entry.inverted_loo:.3f})")
        axes.legend(fontsize=6)
    figure.axes[-1].set_axis_off()
    return figure


def _diagonal(axes: Axes, actual: Floats, predicted: Floats, title: str) -> None:
    ends = [float(np.min(actual)), float(np.max(actual))]
    axes.plot(ends, ends, lw=0.6, color="black")
    axes.plot(actual, predicted, "o", ms=4, mfc="none")
    axes.set_title(title, fontsize=8)
    axes.set(xlabel="actual", ylabel="predicted")


def thesis_figures(fit: ThesisFit, strokes: Sequence[Stroke]) -> list[tuple[str, str, Callable[[], Figure]]]:
    """(name, caption, draw) of every figure that the strokes allow, in the thesis' numbering.

    Figure 16 is there if the strokes hold several forces for other d or h, as the one-factor design does.
    """
    by_code = {stroke.code: stroke for stroke in strokes}
    of_strokes = {9: figure_9, 10: figure_10, 11: figure_11, 12: figure_12, 14: figure_14}
    of_fit = {13: figure_13, 15: figure_15, 17: figure_17, 18: figure_18, 19: figure_19}
    out: list[tuple[str, str, Callable[[], Figure]]] = []
    for number in range(9, 20):
        if number in of_strokes:
            draw = of_strokes[number]
            out.append((f"figure_{number}", str(draw.__doc__), lambda draw=draw: draw(by_code)))  # type: ignore[misc]
        elif number in of_fit:
            draw_fit = of_fit[number]
            out.append((f"figure_{number}", str(draw_fit.__doc__), lambda draw=draw_fit: draw(fit)))  # type: ignore[misc]
        elif any(s.case.d_mm != 10 and s.case.F_rel != 1 for s in strokes):
            out.append(("figure_16", str(figure_16.__doc__), lambda: figure_16(strokes)))
    return out
