"""The field model's results as tables for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from rich.table import Table

from palpate.learn.score import HeldOutRow, ordered
from palpate.learn.table import SHOWN, TARGETS


def held_out(rows: Sequence[HeldOutRow], missed: Sequence[str]) -> Table:
    """R2 and median error of every recipe at every noise level, and the targets missed."""
    out = Table(title="Held-out lumps: R2 / median error")
    for name in (
        "noise",
        "model",
        "strokes",
        "terms",
        "t",
        "d",
        "h",
        "E^-2/3",
        "hard/soft",
        "far from 10",
        "n",
    ):
        out.add_column(name, justify="left" if name in ("noise", "model") else "right")
    for row in rows:
        s = row.scores
        cells = [f"{s[f'{t}_r2']:.3f} / {100 * s[f'{t}_error']:.1f} %" for t in ("t", "d", "h")]
        cells += [
            f"{s['E_inv23_r2']:.3f}",
            f"{100 * s['hard_soft']:.1f} %",
            f"{100 * s['hard_soft_far']:.1f} %",
        ]
        out.add_row(row.noise, row.recipe, str(row.strokes), str(row.terms), *cells, f"{s['n']:.0f}")
    out.caption = "all targets met" if not missed else "missed: " + "; ".join(missed)
    return out


def coverage(groups: pd.DataFrame, level: float, noise: str) -> Table:
    """Coverage of the intervals by group (`score.coverage`)."""
    out = Table(title=f"Coverage of the {100 * level:.0f} % interval (median half-width), noise {noise}")
    out.add_column("lumps")
    for name in (*(SHOWN[t] for t in TARGETS), "n"):
        out.add_column(name, justify="right")
    for group, row in groups.iterrows():
        cells = []
        for t in TARGETS:
            half = row[f"half_{t}"]
            cells.append(
                f"{100 * row[t]:.1f} ({half:.3f})"
                if t == "E_inv23"
                else f"{100 * row[t]:.1f} ({100 * half:.1f} %)"
            )
        out.add_row(str(group), *cells, f"{row['n']:.0f}")
    return out


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
}


def facts(shares: Mapping[str, float], noise: str) -> Table:
    """Domain flags, false alarms, hardness, bounds."""
    out = Table(title=f"Flags, noise {noise}")
    out.add_column("")
    out.add_column("share", justify="right")
    for name, words in _WORDS.items():
        if name in shares:
            out.add_row(words, f"{100 * shares[name]:.1f} %")
    out.add_row("median of that bound", f"E >= {shares['median_bound']:.1f}")
    return out


def flagged(shares: pd.DataFrame) -> Table:
    """The domain flag by distance from the ranges' ends (`flags.by_distance`)."""
    out = Table(title="The flag by distance beyond the ranges, in half-widths of the estimate's interval")
    out.add_column("beyond an end by")
    for name in ("strokes", "flagged", "were errors normal"):
        out.add_column(name, justify="right")
    for row in shares.to_dict("records"):
        out.add_row(_beyond(row["from"], row["to"]), *_distance_cells(pd.DataFrame([row])))
    parts = {
        "inside, all": shares["to"] <= 0,
        "outside, all": shares["from"] >= 0,
        "outside by 1 or more": shares["from"] >= 1,
    }
    for words, rows in parts.items():
        if rows.any():
            out.add_row(words, *_distance_cells(shares[rows]))
    return out


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
    out = Table(title="Left out")
    out.add_column("why")
    out.add_column("strokes", justify="right")
    for why, n in strokes.items():
        out.add_row(why, str(n))
    return out


def found(cells: pd.DataFrame) -> Table:
    """The detectability map (`score.found_by`)."""
    out = Table(title="Lumps found, %, by d (mm), h and E")
    E_ranges = ordered(cells["E"])
    for name in ("d", "h", *(f"E {e}" for e in E_ranges)):
        out.add_column(name, justify="right")
    share = cells.set_index(["d_mm", "h", "E"])["found"].to_dict()
    for d in ordered(cells["d_mm"]):
        for h in ordered(cells["h"]):
            shown = [share.get((d, h, e)) for e in E_ranges]
            out.add_row(d, h, *("" if c is None else f"{100 * c:.0f}" for c in shown))
    return out


def visits(changes: pd.DataFrame) -> Table:
    """The smallest change of diameter that two visits tell apart (`score.visits`)."""
    out = Table(title="Smallest change of diameter that two visits of one stroke tell apart")
    out.add_column("lumps")
    out.add_column("change", justify="right")
    for row in changes.to_dict("records"):
        out.add_row(str(row["group"]), f"{row['percent']:.1f} %")
    return out
