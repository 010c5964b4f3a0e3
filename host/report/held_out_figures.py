"""What the thesis did not have: a model on lumps, and in tissue, that it never saw, drawn from its fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from rich.table import Table

from palpate.features.map_features import Floats
from palpate.learn.conformal import LEVEL
from palpate.learn.result import TissueFit
from palpate.learn.score import ordered
from palpate.report import style
from palpate.report.items import Item

_PERCENT = f"{100 * LEVEL:g}"
_BAND = 2.0
_SHOWN = {
    "ln d": "d, mm",
    "ln t": "t, mm",
    "E^-2/3": "E^-2/3",
    "ln E_fat": "E_fat, kPa",
    "ln F": "F, N/m",
}

Panels = Mapping[str, Sequence[Floats]]
"""Of each panel's title: truth, estimates, lower and upper ends of their intervals, (n) each."""


def items(fit: TissueFit) -> list[Item]:
    """Held-out table with estimates against truth; coverage and flags; detectability."""
    held_out, *further, cover, flags, pairs, found, left_out = map(frame_of, fit.tables())
    names = {name: name for name in fit.outputs}
    return [
        Item(
            "Beyond 1",
            f"One stroke each, noise {fit.noise}, every lump left out of fit and intervals; bars are "
            f"{_PERCENT} % intervals of every sixteenth estimate.",
            draw=lambda: figure_estimates(_estimates(fit), 16),
            tables=[held_out, *further, left_out],
            beyond="Lumps that it never saw",
        ),
        Item(
            "Beyond 2",
            f"Share of true values inside the {_PERCENT} % interval, by quarter of lump and tissue; the grey "
            f"band is +-{_BAND:g} %.",
            draw=lambda: figure_coverage(fit.coverage(), names),
            tables=[cover, flags, pairs],
            beyond="Intervals",
        ),
        Item(
            "Beyond 3",
            "Share of strokes in which the lump was found.",
            draw=lambda: figure_found(fit.found),
            tables=[found],
            beyond="Detectability",
        ),
    ]


def _estimates(fit: TissueFit) -> Panels:
    study, panels = fit.study, {}
    for j, name in enumerate(fit.outputs):
        words = _SHOWN.get(name)
        if words is None:
            continue
        true, y, half = study.seen.truth[:, j], study.y[:, j], study.half[:, j]
        link = np.exp if name.startswith("ln ") else np.asarray
        panels[words] = [link(v) for v in (true, y, y - half, y + half)]
    return panels | {"depth, mm": [np.exp(study.seen.of("ln depth")), *study.depths_mm().T]}


def figure_estimates(panels: Panels, every: int) -> Figure:
    """Estimate against truth, two rows of three; intervals of every n-th."""
    figure = style.new(9.0, 5.8)
    for k, (words, (true, value, low, high)) in enumerate(panels.items(), 1):
        ax = figure.add_subplot(2, 3, k)
        some, ends = slice(None, None, every), [true.min(), true.max()]
        ax.plot(ends, ends, color=style.SOFT, lw=0.8)
        ax.vlines(true[some], low[some], high[some], color=style.ORANGE, lw=0.8, alpha=0.7)
        ax.plot(true, value, ".", ms=2.5, color=style.BLUE)
        ax.set(title=words, xlabel="truth", ylabel="estimate")
    return figure


def figure_coverage(shares: pd.DataFrame, names: Mapping[str, str]) -> Figure:
    """Coverage of every group (row) for every output: names, its column and what it is called."""
    figure = style.new(9.0, max(0.25 * len(shares), 3.0))
    ax = figure.subplots()
    y = np.arange(len(shares))[::-1]
    ax.axvspan(100 * LEVEL - _BAND, 100 * LEVEL + _BAND, color=style.BAND, zorder=0)
    for k, (name, color) in enumerate(zip(names, (*style.COLORS, style.INK))):
        place = y + 0.12 * ((len(names) - 1) / 2 - k)
        ax.plot(100 * shares[name], place, "o", ms=4, color=color, label=names[name])
    ax.axvline(100 * LEVEL, color=style.SOFT, lw=0.8)
    ax.set_yticks(y, [str(group) for group in shares.index])
    ax.set(xlabel="inside the interval, %", xlim=(70, 100))
    ax.legend(ncols=len(names), loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def figure_found(cells: pd.DataFrame) -> Figure:
    """One map of d and depth for each range of E."""
    ranges = ordered(cells["E"])
    figure = style.new(9.0, 3.0)
    d, depth = ordered(cells["d_mm"]), ordered(cells["depth_mm"])
    for ax, E in zip(np.atleast_1d(figure.subplots(1, len(ranges), sharey=True)), ranges):
        part = cells[cells["E"] == E].pivot(index="depth_mm", columns="d_mm", values="found")
        grid = 100 * part.reindex(index=depth, columns=d).to_numpy(float)
        ax.imshow(grid, origin="lower", vmin=0, vmax=100, cmap="Blues", aspect="auto")
        for (i, j), share in np.ndenumerate(grid):
            if share == share:
                ax.text(
                    j, i, f"{share:.0f}", ha="center", va="center", color="white" if share > 60 else style.INK
                )
        ax.set(xticks=range(len(d)), yticks=range(len(depth)), title=f"E {E}: found, %", xlabel="d, mm")
        ax.set_xticklabels(d)
        ax.set_yticklabels(depth)
        ax.grid(False)
    figure.axes[0].set_ylabel("depth, mm")
    return figure


def frame_of(table: Table) -> tuple[str, pd.DataFrame]:
    """A printed table's title, and its cells as text."""
    cells = {str(c.header).replace("\n", " ") or " ": [str(v) for v in c.cells] for c in table.columns}
    return str(table.title or ""), pd.DataFrame(cells)
