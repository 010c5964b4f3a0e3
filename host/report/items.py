"""What a report is made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure


@dataclass(frozen=True)
class Beside:
    """A value of the thesis beside ours, both as text; "" where the thesis gives none."""

    what: str
    thesis: str
    ours: str


@dataclass(frozen=True)
class Item:
    """One figure or table.

    Attributes
    ----------
    name : str
        As the thesis counts: "Figure 13", "Table 1", "Appendix B".
    title : str
        The thesis' title of it.
    caption : str
        What it shows, in a sentence or two.
    beside : list of Beside
    draw : callable, optional
        Draws the figure.
    tables : list of (heading, DataFrame)
    missing : str
        Instead of all that: what would make it.
    """

    name: str
    title: str
    caption: str = ""
    beside: list[Beside] = field(default_factory=list)
    draw: Callable[[], Figure] | None = None
    tables: list[tuple[str, pd.DataFrame]] = field(default_factory=list)
    missing: str = ""

    @property
    def slug(self) -> str:
        """Name of its files and its anchor: figure_13, table_1, appendix_b."""
        return self.name.lower().replace(" ", "_")


@dataclass(frozen=True)
class Summary:
    """What stands before everything else: the answer of a stroke, or of several over one lump.

    Attributes
    ----------
    verdict : str
        The headline: what was found, in a few words.
    text : str
        What kind of strokes these were, in a sentence or two.
    title, says : str
        The section's, and its second column's.
    rows : list of (quantity, value, interval, truth)
        As text.
    picture, narrow : Path
        A PNG of one stroke; the same for a phone.
    interval : str
        What the third column is.
    how : str
        How the values were pooled, if they were.
    """

    verdict: str
    text: str
    title: str
    says: str
    rows: list[tuple[str, str, str, str]]
    picture: Path
    narrow: Path
    interval: str
    how: str = ""


def number(value: float, digits: int = 3) -> str:
    """A number as the report writes it."""
    return f"{value:.{digits}f}"
