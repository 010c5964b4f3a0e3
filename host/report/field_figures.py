"""What the thesis did not have: the field model on lumps it never saw, drawn from its fit."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from rich.table import Table

from palpate.learn.conformal import LEVEL
from palpate.learn.result import FieldFit
from palpate.learn.score import NEAR_THE_BORDER, ordered
from palpate.learn.table import SHOWN, TARGETS
from palpate.model_export.vocabulary import SHOWN_UNITS
from palpate.report import style
from palpate.report.items import Item

_PERCENT = f"{100 * LEVEL:g}"
_UNITS = {s: f"({u})" if u else "" for s, u in zip(TARGETS, SHOWN_UNITS.values())}


def items(fit: FieldFit) -> list[Item]:
    """Held-out table with estimates against truth, coverage, detectability."""
    held_out, cover, flags, distance, left_out, found, visits = (frame_of(t) for t in fit.tables())
    return [
        Item(
            "Beyond 1",
            "The field model on lumps it never saw",
            f"One stroke each, noise {fit.noise}; bars are {_PERCENT} % intervals of every eighth estimate.",
            draw=lambda: figure_estimates(fit),
            tables=[held_out, left_out],
        ),
        Item(
            "Beyond 2",
            "Intervals",
            f"Share of true values inside the {_PERCENT} % interval, by group; the grey band is +-2 %.",
            draw=lambda: figure_coverage(fit),
            tables=[cover, flags, distance],
        ),
        Item(
            "Beyond 3",
            "Detectability",
            "Share of strokes in which the lump was found.",
            draw=lambda: figure_found(fit),
            tables=[found, visits],
        ),
    ]


def figure_estimates(fit: FieldFit) -> Figure:
    """Estimate against truth for every output."""
    figure = style.new(9.0, 5.8)
    axes = list(figure.subplots(2, len(TARGETS) // 2 + 1).flat)
    found = fit.answers.found
    truth, value = fit.test.values[found], fit.answers.value[found]
    low, high = fit.answers.low[found], fit.answers.high[found]
    some = np.arange(0, len(truth), 8)
    for j, (ax, name) in enumerate(zip(axes, TARGETS)):
        ends = [truth[:, j].min(), truth[:, j].max()]
        ax.plot(ends, ends, color=style.SOFT, lw=0.8)
        ax.vlines(truth[some, j], low[some, j], high[some, j], color=style.ORANGE, lw=0.8, alpha=0.7)
        ax.plot(truth[:, j], value[:, j], ".", ms=3, color=style.BLUE)
        ax.set(title=f"{SHOWN[name]} {_UNITS[name]}", xlabel="truth", ylabel="estimate")
    E = truth[:, 4] ** -1.5
    order = np.argsort(E)
    right = (fit.answers.hardness[found] == "hard") == (E >= 10)
    decided = fit.answers.hardness[found] != "unsure"
    window = max(len(E) // 20, 5)
    smooth = np.ones(window) / window
    last = axes[-1]
    last.plot(
        E[order][: 1 - window or None],
        np.convolve(decided[order], smooth, "valid"),
        label="hard or soft said",
    )
    wrong = np.convolve((decided & ~right)[order], smooth, "valid")
    last.plot(E[order][: 1 - window or None], wrong, label="said, and wrong")
    last.axvspan(*NEAR_THE_BORDER, color="#e6ebef", zorder=0)
    last.set(xscale="log", xlabel="E", title="hard, soft or unsure", ylim=(-0.02, 1.02))
    last.legend()
    return figure


def figure_coverage(fit: FieldFit) -> Figure:
    """Coverage of every group for every output."""
    figure = style.new(9.0, 4.8)
    ax = figure.subplots()
    y = np.arange(len(fit.coverage))[::-1]
    ax.axvspan(100 * LEVEL - 2, 100 * LEVEL + 2, color="#e6ebef", zorder=0)
    for k, (name, color) in enumerate(zip(TARGETS, style.COLORS)):
        ax.plot(100 * fit.coverage[name], y + 0.12 * (2 - k), "o", color=color, label=SHOWN[name])
    ax.axvline(100 * LEVEL, color=style.SOFT, lw=0.8)
    ax.set_yticks(y, [str(g) for g in fit.coverage.index])
    ax.set(xlabel="inside the interval, %", xlim=(70, 100))
    ax.legend(ncols=5, loc="upper center", bbox_to_anchor=(0.5, 1.1))
    return figure


def figure_found(fit: FieldFit) -> Figure:
    """One map of d and h for each range of E."""
    ranges = ordered(fit.found["E"])
    figure = style.new(9.0, 3.0)
    for ax, E in zip(np.atleast_1d(figure.subplots(1, len(ranges), sharey=True)), ranges):
        part = fit.found[fit.found["E"] == E]
        d, h = ordered(fit.found["d_mm"]), ordered(fit.found["h"])
        grid = np.full((len(h), len(d)), np.nan)
        for row in part.itertuples():
            grid[h.index(str(row.h)), d.index(str(row.d_mm))] = 100 * float(row.found)  # type: ignore[arg-type]
        ax.imshow(grid, origin="lower", vmin=0, vmax=100, cmap="Blues", aspect="auto")
        for (i, j), share in np.ndenumerate(grid):
            if share == share:
                ax.text(
                    j, i, f"{share:.0f}", ha="center", va="center", color="white" if share > 60 else style.INK
                )
        ax.set(xticks=range(len(d)), yticks=range(len(h)), title=f"E {E}: found, %", xlabel="d, mm")
        ax.set_xticklabels(d)
        ax.set_yticklabels(h)
        ax.grid(False)
    figure.axes[0].set_ylabel("h")
    return figure


def frame_of(table: Table) -> tuple[str, pd.DataFrame]:
    """A printed table's title, and its cells as text."""
    cells = {str(c.header).replace("\n", " ") or " ": [str(v) for v in c.cells] for c in table.columns}
    return str(table.title or ""), pd.DataFrame(cells)
