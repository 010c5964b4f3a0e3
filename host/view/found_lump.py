"""Where a stroke's lump lies and how large it is, as far as the probe has told. Units: mm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from palpate.sim.probe.cells import COLUMN_MM, PITCH_MM
from palpate.view.events import Estimate, Interval, ProbeMap


@dataclass(frozen=True)
class FoundLump:
    """A lump on the tissue.

    Attributes
    ----------
    along_mm : float
        Its middle along the stroke, as the encoder counts.
    d_mm : Interval
        Its length along the stroke.
    columns_mm : (first, last) or None
        Edges of the columns that felt it, from the middle of the face; None where all felt it alike.
    across_mm, width_mm : Interval or None
        Its middle across the stroke, and its width, where a model tells them.
    sure : bool
        Whether the card vouches for the numbers.
    """

    along_mm: float
    d_mm: Interval
    columns_mm: tuple[float, float] | None = None
    across_mm: Interval | None = None
    width_mm: Interval | None = None
    sure: bool = True

    def as_dict(self) -> dict[str, Any]:
        """For the page; intervals as [value, low, high]."""
        return {
            "along_mm": round(self.along_mm, 3),
            "d_mm": _rounded(self.d_mm),
            "columns_mm": None if self.columns_mm is None else list(self.columns_mm),
            "across_mm": _rounded(self.across_mm),
            "width_mm": _rounded(self.width_mm),
            "sure": self.sure,
        }


def found_lump(kind: str, estimate: Estimate | None, probe_map: ProbeMap | None) -> FoundLump | None:
    """The lump of a stroke whose card is of this kind (`phrases.verdict`); None where it tells of none."""
    if kind not in ("lump", "outside") or estimate is None or estimate.d_mm is None:
        return None
    if probe_map is None or probe_map.fit is None:
        return None
    return FoundLump(
        along_mm=probe_map.fit.centre_mm,
        d_mm=estimate.d_mm,
        columns_mm=_edges(probe_map.columns),
        across_mm=estimate.place_mm,
        width_mm=estimate.width_mm,
        sure=kind == "lump",
    )


def _edges(columns: tuple[int, int] | None) -> tuple[float, float] | None:
    """From where to where these columns reach; None for all of them."""
    if columns is None or columns[1] - columns[0] >= COLUMN_MM.size or columns[0] >= columns[1]:
        return None
    half = PITCH_MM / 2
    return float(COLUMN_MM[columns[0]] - half), float(COLUMN_MM[columns[1] - 1] + half)


def _rounded(interval: Interval | None) -> list[float] | None:
    if interval is None:
        return None
    return [round(v, 3) for v in (interval.value, interval.low, interval.high)]
