"""The model that is not told its tissue, on lumps and tissue that it never saw, drawn from its fit."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from palpate.learn.conformal import LEVEL
from palpate.learn.probe_model import OUTPUTS
from palpate.learn.result import TissueFit
from palpate.report import style
from palpate.report.field_figures import frame_of
from palpate.report.items import Item

_PERCENT = f"{100 * LEVEL:g}"
_SHOWN = {"ln d": "d, mm", "ln t": "t, mm", "E^-2/3": "E^-2/3", "ln E_fat": "E_fat, kPa", "ln F": "F, N/m"}


def items(fit: TissueFit) -> list[Item]:
    """Held-out table with estimates against truth; coverage and flags."""
    held_out, *further, cover, flags, pairs, left_out = (frame_of(table) for table in fit.tables())
    return [
        Item(
            "Beyond 1",
            "In tissue that nobody told it about",
            f"One stroke each with its press, noise {fit.noise}, every lump and tissue left out of fit and "
            f"intervals; bars are {_PERCENT} % intervals of every sixteenth estimate.",
            draw=lambda: figure_estimates(fit),
            tables=[held_out, *further, left_out],
        ),
        Item(
            "Beyond 2",
            "Intervals",
            f"Share of true values inside the {_PERCENT} % interval, by quarter of lump and tissue; the grey "
            "band is +-2 %.",
            draw=lambda: figure_coverage(fit),
            tables=[cover, flags, pairs],
        ),
    ]


def figure_estimates(fit: TissueFit) -> Figure:
    """Estimate against truth for every output, and for the depth."""
    study = fit.study
    true, y, half = study.seen.truth, study.y, study.half
    panels = {}
    for name, words in _SHOWN.items():
        j = OUTPUTS.index(name)
        link = np.exp if name.startswith("ln ") else np.asarray
        panels[words] = [link(v) for v in (true[:, j], y[:, j], y[:, j] - half[:, j], y[:, j] + half[:, j])]
    depth = np.exp(study.seen.of("ln depth"))
    panels["depth, mm"] = [depth, *study.depths_mm().T]
    figure = style.new(9.0, 5.8)
    some = np.arange(0, len(y), 16)
    for ax, (words, (of, value, low, high)) in zip(figure.subplots(2, 3).flat, panels.items()):
        ends = [of.min(), of.max()]
        ax.plot(ends, ends, color=style.SOFT, lw=0.8)
        ax.vlines(of[some], low[some], high[some], color=style.ORANGE, lw=0.8, alpha=0.7)
        ax.plot(of, value, ".", ms=2, color=style.BLUE)
        ax.set(title=words, xlabel="truth", ylabel="estimate")
    return figure


def figure_coverage(fit: TissueFit) -> Figure:
    """Coverage of every quarter for every output."""
    found = fit.coverage()
    figure = style.new(9.0, 7.0)
    ax = figure.subplots()
    y = np.arange(len(found))[::-1]
    ax.axvspan(100 * LEVEL - 2, 100 * LEVEL + 2, color="#e6ebef", zorder=0)
    for k, (name, color) in enumerate(zip(OUTPUTS, (*style.COLORS, style.INK))):
        ax.plot(100 * found[name], y + 0.12 * (2.5 - k), "o", ms=4, color=color, label=name)
    ax.axvline(100 * LEVEL, color=style.SOFT, lw=0.8)
    ax.set_yticks(y, [str(group) for group in found.index])
    ax.set(xlabel="inside the interval, %", xlim=(70, 100))
    ax.legend(ncols=6, loc="upper center", bbox_to_anchor=(0.5, 1.06))
    return figure
