"""What the thesis did not have: a model on lumps, and in tissue, that it never saw, drawn from its fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.table import Table

from palpate.features.map_features import Floats
from palpate.learn.conformal import LEVEL
from palpate.learn.probe_model import E_INV23, OUTPUTS
from palpate.learn.result import FieldFit, TissueFit
from palpate.learn.score import NEAR_THE_BORDER, ordered
from palpate.learn.table import SHOWN, TARGETS
from palpate.model_export.vocabulary import SHOWN_UNITS
from palpate.report import style
from palpate.report.items import Item

_PERCENT = f"{100 * LEVEL:g}"
_BAND = 2.0
_UNITS = dict(zip(TARGETS, SHOWN_UNITS.values()))
_IN_ANY_TISSUE = {
    "ln d": "d, mm",
    "ln t": "t, mm",
    "E^-2/3": "E^-2/3",
    "ln E_fat": "E_fat, kPa",
    "ln F": "F, N/m",
}

Panels = Mapping[str, Sequence[Floats]]
"""Of each panel's title: truth, estimates, lower and upper ends of their intervals, (n) each."""


def items(fit: FieldFit | TissueFit) -> list[Item]:
    """Held-out table with estimates against truth; coverage and flags; where it is known, detectability."""
    return _in_one_tissue(fit) if isinstance(fit, FieldFit) else _in_any_tissue(fit)


def _in_one_tissue(fit: FieldFit) -> list[Item]:
    held_out, cover, flags, distance, left_out, found, visits = map(frame_of, fit.tables())
    return [
        Item(
            "Beyond 1",
            f"One stroke each, noise {fit.noise}; bars are {_PERCENT} % intervals of every eighth estimate.",
            draw=lambda: _told_estimates(fit),
            tables=[held_out, left_out],
            beyond="The field model on lumps it never saw",
        ),
        _intervals("by group", fit.coverage, SHOWN, [cover, flags, distance]),
        Item(
            "Beyond 3",
            "Share of strokes in which the lump was found.",
            draw=lambda: figure_found(fit.found),
            tables=[found, visits],
            beyond="Detectability",
        ),
    ]


def _in_any_tissue(fit: TissueFit) -> list[Item]:
    held_out, *further, cover, flags, pairs, left_out = map(frame_of, fit.tables())
    names = {name: name for name in OUTPUTS}
    return [
        Item(
            "Beyond 1",
            f"One stroke each with its press, noise {fit.noise}, every lump and tissue left out of fit and "
            f"intervals; bars are {_PERCENT} % intervals of every sixteenth estimate.",
            draw=lambda: figure_estimates(_estimates(fit), 16),
            tables=[held_out, *further, left_out],
            beyond="In tissue that nobody told it about",
        ),
        _intervals("by quarter of lump and tissue", fit.coverage(), names, [cover, flags, pairs]),
    ]


def _intervals(
    groups: str, coverage: pd.DataFrame, names: Mapping[str, str], tables: list[tuple[str, pd.DataFrame]]
) -> Item:
    return Item(
        "Beyond 2",
        f"Share of true values inside the {_PERCENT} % interval, {groups}; the grey band is +-{_BAND:g} %.",
        draw=lambda: figure_coverage(coverage, names),
        tables=tables,
        beyond="Intervals",
    )


def _estimates(fit: TissueFit) -> Panels:
    study, panels = fit.study, {}
    for name, words in _IN_ANY_TISSUE.items():
        j = OUTPUTS.index(name)
        true, y, half = study.seen.truth[:, j], study.y[:, j], study.half[:, j]
        link = np.exp if name.startswith("ln ") else np.asarray
        panels[words] = [link(v) for v in (true, y, y - half, y + half)]
    return panels | {"depth, mm": [np.exp(study.seen.of("ln depth")), *study.depths_mm().T]}


def _told_estimates(fit: FieldFit) -> Figure:
    found, answers = fit.answers.found, fit.answers
    of = [part[found] for part in (fit.test.values, answers.value, answers.low, answers.high)]
    panels = {
        f"{SHOWN[name]} {f'({unit})' if unit else ''}": [part[:, j] for part in of]
        for j, (name, unit) in enumerate(_UNITS.items())
    }
    figure = figure_estimates(panels, 8)
    E = of[0][:, E_INV23] ** -1.5
    _draw_hardness(figure, E, answers.hardness[found])
    return figure


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


def _draw_hardness(figure: Figure, E: Floats, said: NDArray[np.str_]) -> None:
    """In the sixth panel: how often hard or soft is said, and wrongly, by stiffness."""
    order = np.argsort(E)
    decided = said != "unsure"
    wrong = decided & ((said == "hard") != (E >= 10))
    window = max(len(E) // 20, 5)
    ax = figure.add_subplot(2, 3, 6)
    for shares, words in ((decided, "hard or soft said"), (wrong, "said, and wrong")):
        smooth = np.convolve(shares[order], np.ones(window) / window, "valid")
        ax.plot(E[order][: 1 - window or None], smooth, label=words)
    ax.axvspan(*NEAR_THE_BORDER, color=style.BAND, zorder=0)
    ax.set(xscale="log", xlabel="E", title="hard, soft or unsure", ylim=(-0.02, 1.02))
    ax.legend()


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
    """One map of d and h for each range of E."""
    ranges = ordered(cells["E"])
    figure = style.new(9.0, 3.0)
    for ax, E in zip(np.atleast_1d(figure.subplots(1, len(ranges), sharey=True)), ranges):
        part = cells[cells["E"] == E]
        d, h = ordered(cells["d_mm"]), ordered(cells["h"])
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
