"""Where a stroke's lump lies and how large it is, as far as the probe has told. Units: mm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from palpate.spans import Span
from palpate.wire.cells import COLUMN_MM, PITCH_MM
from palpate.wire.events import Estimate, TactileMap

if TYPE_CHECKING:
    from palpate.answer.told import AcrossStroke


@dataclass(frozen=True)
class FoundLump:
    """A lump on the tissue.

    Attributes
    ----------
    along_mm : float
        Its middle along the stroke, as the encoder counts.
    d_mm : value, low, high
        Its length along the stroke.
    columns_mm : (first, last) or None
        Edges of the columns that felt it, from the middle of the face; None where all felt it alike.
    across_mm, width_mm : value, low, high, or None
        Its middle across the stroke, and its width, where a model tells them.
    sure : bool
        Whether the card vouches for the numbers.
    """

    along_mm: float
    d_mm: Span
    columns_mm: tuple[float, float] | None = None
    across_mm: Span | None = None
    width_mm: Span | None = None
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


def found_lump(
    kind: str, estimate: Estimate | None, across: AcrossStroke | None, probe_map: TactileMap | None
) -> FoundLump | None:
    """The lump of a stroke whose card is of this kind (`card.verdict`); None where it tells of none."""
    if kind not in ("lump", "outside") or estimate is None or "d_mm" not in estimate.outputs:
        return None
    if probe_map is None or (fit := probe_map.fit) is None:
        return None
    return FoundLump(
        along_mm=fit.centre_mm,
        d_mm=estimate.span("d_mm"),
        columns_mm=_edges(probe_map.first_column, probe_map.end_column),
        across_mm=None if across is None else across.place_mm,
        width_mm=None if across is None else across.width_mm,
        sure=kind == "lump",
    )


def _edges(first: int, end: int) -> tuple[float, float] | None:
    """From where to where these columns reach; None for all of them."""
    if end - first >= COLUMN_MM.size or first >= end:
        return None
    half = PITCH_MM / 2
    return float(COLUMN_MM[first] - half), float(COLUMN_MM[end - 1] + half)


def _rounded(span: Span | None) -> list[float] | None:
    return None if span is None else [round(v, 3) for v in span]
