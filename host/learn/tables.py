"""A fit's results as tables for a terminal."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from rich.table import Table

from palpate.learn.score import HeldOutRow, ordered
from palpate.learn.table import SHOWN, TARGETS


def shown(
    title: str,
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    text: Collection[str] | None = None,
    no_wrap: bool = False,
    **look: Any,
) -> Table:
    """A table whose columns of `text`, by default the first, are aligned to the left, numbers to the right.

    no_wrap : whether numbers stay on one line; look : further arguments of `rich.table.Table`.
    """
    out = Table(title=title, **look)
    for head in heads:
        left = head in (heads[:1] if text is None else text)
        out.add_column(head, justify="left" if left else "right", no_wrap=no_wrap and not left)
    for row in rows:
        out.add_row(*row)
    return out


def held_out(rows: Sequence[HeldOutRow], missed: Sequence[str]) -> Table:
    """R2 and median error of every recipe at every noise level, and the targets missed."""
    heads = ("noise", "model", "strokes", "terms", "t", "d", "h", "E^-2/3", "hard/soft", "far from 10", "n")
    lines = []
    for row in rows:
        s = row.scores
        cells = [f"{s[f'{t}_r2']:.3f} / {100 * s[f'{t}_error']:.1f} %" for t in ("t", "d", "h")]
        cells += [f"{s['E_inv23_r2']:.3f}", *(f"{100 * s[k]:.1f} %" for k in ("hard_soft", "hard_soft_far"))]
        lines.append([row.noise, row.recipe, str(row.strokes), str(row.terms), *cells, f"{s['n']:.0f}"])
    return shown(
        "Held-out lumps: R2 / median error", heads, lines, ("noise", "model"), caption=targets(missed)
    )


def targets(missed: Sequence[str]) -> str:
    """Which targets were not reached, as a table's caption."""
    return "missed: " + "; ".join(missed) if missed else "all targets met"


def coverage(groups: pd.DataFrame, level: float, noise: str) -> Table:
    """Coverage of the intervals by group (`score.coverage`)."""

    def cell(row: pd.Series, name: str) -> str:
        half = row[f"half_{name}"]
        return f"{100 * row[name]:.1f} ({f'{half:.3f}' if name == 'E_inv23' else f'{100 * half:.1f} %'})"

    return shown(
        f"Coverage of the {100 * level:.0f} % interval (median half-width), noise {noise}",
        ("lumps", *(SHOWN[t] for t in TARGETS), "n"),
        (
            [str(group), *(cell(row, t) for t in TARGETS), f"{row['n']:.0f}"]
            for group, row in groups.iterrows()
        ),
    )


_WORDS = {
    "decided": "hard or soft said, not unsure",
    "wrong_of_decided": "wrong of these",
    "hard_called_soft": "hard lumps called soft",
    "soft_called_hard": "soft lumps called hard",
    "E_is_a_bound": "E given as a lower bound",
    "flagged_inside": "lumps inside the ranges flagged as out of domain",
    "flagged_outside": "lumps outside them flagged, of those found",
    "outside_no_lump": "lumps outside not found",
    "flagged_or_not_found_outside": "lumps outside flagged or not found",
    "flagged_well_outside": "lumps well outside (5 % or more beyond an end) flagged, of those found",
    "false_alarms": "plain tissue taken for a lump",
    "false_alarms_not_flagged": "plain tissue taken for a lump, and not flagged",
}


def facts(shares: Mapping[str, float], noise: str) -> Table:
    """Domain flags, false alarms; where they are known hardness, bounds."""
    rows = [[words, f"{100 * shares[name]:.1f} %"] for name, words in _WORDS.items() if name in shares]
    if "median_bound" in shares:
        rows.append(["median of that bound", f"E >= {shares['median_bound']:.1f}"])
    return shown(f"Flags, noise {noise}", ("", "share"), rows)


def flagged(shares: pd.DataFrame) -> Table:
    """The domain flag by distance from the ranges' ends (`flags.by_distance`)."""
    parts = {_beyond(row["from"], row["to"]): shares.loc[[k]] for k, row in shares.iterrows()}
    whole = {
        "inside, all": shares[shares["to"] <= 0],
        "outside, all": shares[shares["from"] >= 0],
        "outside by 1 or more": shares[shares["from"] >= 1],
    }
    return shown(
        "The flag by distance beyond the ranges, in half-widths of the estimate's interval",
        ("beyond an end by", "strokes", "flagged", "were errors normal"),
        ([words, *_distance_cells(rows)] for words, rows in (parts | whole).items() if len(rows)),
    )


def _distance_cells(rows: pd.DataFrame) -> list[str]:
    n = rows["strokes"]
    return [str(n.sum()), *(f"{100 * (rows[k] * n).sum() / n.sum():.1f} %" for k in ("flagged", "unbiased"))]


def _beyond(low: float, high: float) -> str:
    if high <= 0:
        inner = f"inside by {abs(high):g}"
        return f"{inner} to {-low:g}" if np.isfinite(low) else f"{inner} or more"
    return f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} or more"


def excluded(strokes: Mapping[str, int]) -> Table:
    """Why strokes were left out, and how many."""
    return shown("Left out", ("why", "strokes"), ([why, str(n)] for why, n in strokes.items()))


def found(cells: pd.DataFrame) -> Table:
    """The detectability map (`score.found_by`)."""
    E_ranges = ordered(cells["E"])
    share = cells.set_index(["d_mm", "h", "E"])["found"].to_dict()
    rows = []
    for d in ordered(cells["d_mm"]):
        for h in ordered(cells["h"]):
            of = [share.get((d, h, e)) for e in E_ranges]
            rows.append([d, h, *("" if c is None else f"{100 * c:.0f}" for c in of)])
    heads = ("d", "h", *(f"E {e}" for e in E_ranges))
    return shown("Lumps found, %, by d (mm), h and E", heads, rows, text=())


def visits(changes: pd.DataFrame) -> Table:
    """The smallest change of diameter that two visits tell apart (`score.visits`)."""
    rows = ([str(row["group"]), f"{row['percent']:.1f} %"] for row in changes.to_dict("records"))
    title = "Smallest change of diameter that two visits of one stroke tell apart"
    return shown(title, ("lumps", "change"), rows)
