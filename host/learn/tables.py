"""A fit's results as tables for a terminal."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import pandas as pd
from rich.table import Table

from palpate.learn.score import ordered


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


def targets(missed: Sequence[str]) -> str:
    """Which targets were not reached, as a table's caption."""
    return "missed: " + "; ".join(missed) if missed else "all targets met"


_WORDS = {
    "flagged_inside": "lumps inside the ranges flagged as out of domain",
    "flagged_outside": "lumps outside them flagged, of those found",
    "outside_no_lump": "lumps outside not found",
    "flagged_or_not_found_outside": "lumps outside flagged or not found",
    "flagged_well_outside": "lumps well outside (5 % or more beyond an end) flagged, of those found",
    "false_alarms": "plain tissue taken for a lump",
    "false_alarms_not_flagged": "plain tissue taken for a lump, and not flagged",
}


def facts(shares: Mapping[str, float], noise: str) -> Table:
    """Domain flags, false alarms."""
    rows = [[words, f"{100 * shares[name]:.1f} %"] for name, words in _WORDS.items() if name in shares]
    return shown(f"Flags, noise {noise}", ("", "share"), rows)


def excluded(strokes: Mapping[str, int]) -> Table:
    """Why strokes were left out, and how many."""
    return shown("Left out", ("why", "strokes"), ([why, str(n)] for why, n in strokes.items()))


def found(cells: pd.DataFrame) -> Table:
    """The map of lumps that are found (`score.found_by`)."""
    stiff = ordered(cells["E"])
    of = {(row.d_mm, row.depth_mm, row.E): f"{100 * float(row.found):.0f}" for row in cells.itertuples()}  # type: ignore[arg-type]
    rows = []
    for d in ordered(cells["d_mm"]):
        for depth in ordered(cells["depth_mm"]):
            shares = [of.get((d, depth, E), "") for E in stiff]
            rows += [[d, depth, *shares]] if any(shares) else []
    heads = ("d", "depth", *(f"E {e}" for e in stiff))
    return shown("Lumps found, %, by d and depth (mm) and E", heads, rows, text=())
