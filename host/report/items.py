"""What a report is made of."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

TITLES = {
    "Figure 2": "A Two-Dimensional Tactile Map of a Real Tumor",
    "Figure 6d": "Development of the Finite Element Model: the final mesh",
    "Figure 7": "Finite Element Models for Selected Tissue Geometries",
    "Figure 8": "Tissue Deformation and Tactile Images",
    "Figure 9": "Formation of Tactile Maps from Contact Pressure Data",
    "Figure 10": "Feature Extraction (Tactile Maps and Tactile Images)",
    "Figure 11": 'Feature Extraction (Displacement and Pressure "Jumps")',
    "Figure 12": "The Effects of Input Parameters on Tactile Maps",
    "Figure 13": "The Relationship Between Input and Output Parameters",
    "Figure 14": "The Effects of Input Parameters on Probe Displacement",
    "Figure 15": "Strain-Force Curves (Different E)",
    "Figure 16": "Strain-Force Curves (Different d and h)",
    "Figure 17": "Validity of the Forward Models",
    "Figure 18": "Validity of the Inverse Models (Using Pressure Only)",
    "Figure 19": "Validity of the Inverse Models (Using Pressure and Displacement)",
    "Figure 20": "Gaussian Fit to a Real Tactile Map",
    "Figure 21": "Strain-Force Curves Generated Using a Real Tactile Probe",
    "Table 1": "Summary of the complete Inverse Model",
    "Appendix A": "Raw Data from Simulations",
    "Appendix B": "Regression Analysis Results for the Forward Model",
    "Appendix C": "Regression Analysis Results for the Inverse Model",
}
"""The thesis' titles by its numbering, in its order."""


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
    caption : str
        What it shows, in a sentence or two.
    beside : list of Beside
    draw : callable, optional
        Draws the figure.
    tables : list of (heading, DataFrame)
    missing : str
        Instead of all that: what would make it.
    beyond : str
        The title of what the thesis does not have.
    """

    name: str
    caption: str = ""
    beside: list[Beside] = field(default_factory=list)
    draw: Callable[[], Figure] | None = None
    tables: list[tuple[str, pd.DataFrame]] = field(default_factory=list)
    missing: str = ""
    beyond: str = ""

    @property
    def title(self) -> str:
        """The thesis' title of it, or its own."""
        return self.beyond or TITLES[self.name]

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


def lacking(names: Iterable[str], why: str) -> list[Item]:
    """What cannot be made, and what would make it."""
    return [Item(name, missing=why) for name in names]


def number(value: float, digits: int = 3) -> str:
    """A number as the report writes it."""
    return f"{value:.{digits}f}"
