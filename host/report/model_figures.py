"""Figures 13 and 17 to 19: the effects of single inputs, and how well the models hold."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.features.map_features import Floats
from palpate.learn.table import SHOWN, TARGETS, target_values
from palpate.learn.thesis.fit import ThesisFit
from palpate.learn.thesis.forward import OUTPUT_NAMES
from palpate.report import style
from palpate.report.items import Beside, Item, number

_THESIS_CURVES = {
    ("base_kPa", "F_rel"): "Base proportional to F",
    ("curvature", "F_rel"): "Curvature ~ F^-1.1",
    ("curvature", "t_mm"): "Curvature ~ t^-0.55",
    ("curvature", "E_ratio"): "no effect of E",
    ("amp_kPa", "E_ratio"): "Amp linear in E^-2/3, soon at its maximum",
}
"""What the thesis says about the graphs of Figure 13."""


_INPUTS = {
    "F_rel": "force F (1 is 100 N/m)",
    "t_mm": "fat thickness t (mm)",
    "d_mm": "diameter d (mm)",
    "h": "relative depth h",
    "E_ratio": "stiffness E (times fat)",
}


def items(fit: ThesisFit) -> list[Item]:
    """Figures 13, 17, 18 and 19 of a fit."""
    curves = [
        Beside(
            f"{OUTPUT_NAMES[c.output]} against {c.input.split('_')[0]}",
            _THESIS_CURVES.get((c.output, c.input), "curve only"),
            f"{c.text()} (R2 {c.r2:.3f}; {c.without_text()})",
        )
        for c in fit.curves
    ]
    forward = [
        Beside(f"{OUTPUT_NAMES[name]}, R2", "almost 1", number(equation.r2_value, 4))
        for name, equation in fit.forward.items()
    ]
    return [
        Item(
            "Figure 13",
            "One output against one input, all others as in the reference case, relative to it, with the "
            "best curve, and what its exponent (of E: its slope) becomes without the run that it depends on "
            "most. Curvature against F rests on the run with F = .2, where contact barely reaches the places "
            "8 mm from the middle. A face that is rounded off from 5 mm on gives the thesis' exponents, "
            "F^-1.12 (R2 .99) and t^-0.54: python -m tests.benchmarks.thesis_probe.",
            curves,
            lambda: figure_13(fit),
        ),
        Item(
            "Figure 17",
            "What the forward model predicts against what the simulation gave, relative to the reference "
            "case.",
            forward,
            lambda: figure_17(fit),
        ),
        _validity(fit, "Figure 18", displacement=False),
        _validity(fit, "Figure 19", displacement=True),
    ]


def _validity(fit: ThesisFit, name: str, *, displacement: bool) -> Item:
    beside = []
    for target in TARGETS:
        entry = fit.entry(target, "all", displacement)
        thesis = "" if entry.thesis_r2 is None else number(entry.thesis_r2)
        ours = (
            f"{entry.direct.r2_in:.3f}; left out {entry.direct.r2_loo:.3f}; inverted forward model left out "
            f"{entry.inverted_loo:.3f}"
        )
        beside.append(Beside(f"{SHOWN[target]}, R2", thesis, ours))
    return Item(
        name,
        "Estimated against true inputs. Circles: equations fitted to all runs, as in the thesis. Crosses: "
        "each run left "
        "out of the fit that estimates it, its terms chosen without it. The thesis' R2 are in sample.",
        beside,
        lambda: figure_inverse(fit, displacement=displacement),
    )


def figure_13(fit: ThesisFit) -> Figure:
    """Each output against one input, with its curve."""
    figure = style.new(9, 8.2)
    for ax, curve in zip(figure.subplots(4, 3).flat, fit.curves):
        x = np.geomspace(curve.x.min(), curve.x.max(), 80)
        ax.plot(x, curve(x), color=style.ORANGE)
        ax.plot(curve.x, curve.y, "o")
        if curve.input == "E_ratio":
            ax.set_xscale("log")
        y = np.concatenate((curve.y, curve(x)))
        if np.ptp(y) < 0.02 * y.mean():
            ax.set_ylim(0.8 * y.mean(), 1.2 * y.mean())
        ax.set_title(style.powers(curve.text()), fontsize=8.5)
        ax.set_xlabel(_INPUTS[curve.input], fontsize=8)
    return figure


def figure_17(fit: ThesisFit) -> Figure:
    """Forward model: predicted against actual."""
    figure = style.new(8.4, 5.2)
    for ax, (name, equation) in zip(figure.subplots(2, 3).flat, fit.forward.items()):
        diagonal(ax, equation.actual, equation.predicted)
        ax.set_title(style.powers(f"{OUTPUT_NAMES[name]}, R2 {equation.r2_value:.4f}"))
    return figure


def figure_inverse(fit: ThesisFit, *, displacement: bool) -> Figure:
    """Inverse models: direct equations in sample and left out, inverted forward model left out."""
    figure = style.new(8.8, 5.6)
    kind = "displacement" if displacement else "pressure"
    truth = target_values(fit.table)
    axes = list(figure.subplots(2, len(TARGETS) // 2 + 1).flat)
    for ax, target in zip(axes, TARGETS):
        entry = fit.entry(target, "all", displacement)
        runs = entry.direct.runs
        diagonal(ax, runs["truth"].to_numpy(), runs["estimate"].to_numpy(), label="all runs")
        ax.plot(runs["truth"], runs["loo"], "x", color=style.ORANGE, label="left out")
        inverted = fit.inverted[f"{kind}_loo"][target]
        ax.plot(
            truth[target], inverted, "+", ms=6, color=style.TEAL, label="inverted forward model, left out"
        )
        ax.set_title(
            style.powers(f"{SHOWN[target]}: R2 {entry.direct.r2_in:.3f}, left out {entry.direct.r2_loo:.3f}"),
            fontsize=8.5,
        )
    axes[-1].axis("off")
    axes[-1].legend(*axes[0].get_legend_handles_labels(), loc="center", fontsize=8.5)
    return figure


def diagonal(ax: Axes, actual: Floats, predicted: Floats, label: str = "") -> None:
    """Predicted against actual, with the line where they agree."""
    ends = [float(np.min(actual)), float(np.max(actual))]
    ax.plot(ends, ends, lw=0.8, color=style.SOFT)
    ax.plot(actual, predicted, "o", mfc="none", color=style.BLUE, label=label)
    ax.set(xlabel="true", ylabel="predicted")
