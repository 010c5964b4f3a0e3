"""Lanes: how far across the tissue a visit's strokes lie beside one another. Units: mm.

The encoder knows where the probe is along a stroke; where it is across nobody knows but the operator, who
says so or does not.
"""

from __future__ import annotations

import re

STEP_MM = 20.0
"""From one lane to the next, unless the operator says otherwise: half the face, so that lanes overlap."""
MOST_MM = 500.0

_MARK = re.compile(r"lane (-?\d{1,4}(?:\.\d+)?) mm, stroke of (\d{1,12}\.\d{3}) s")


class Lanes:
    """Which lane the next stroke of a visit goes to; each that begins moves on by one step.

    Attributes
    ----------
    told : bool
        Whether the operator says where strokes go.
    next_mm, step_mm : float
    changes : int
        How often any of it has changed: of two states a page takes the later.
    """

    def __init__(self) -> None:
        self.told = False
        self.next_mm = 0.0
        self.step_mm = STEP_MM
        self.changes = 0
        self._begun: tuple[float, int] | None = None

    def set(self, told: bool, next_mm: float, step_mm: float) -> None:
        """The operator says where the next stroke goes and how far on the one after it, or no longer."""
        self.told = told
        self.next_mm = _rounded(next_mm)
        self.step_mm = _rounded(step_mm)
        self.changes += 1

    def begin(self) -> float | None:
        """A stroke begins: its lane, None where the operator says nothing of lanes."""
        if not self.told:
            return None
        lane_mm = self.next_mm
        self.next_mm = _rounded(lane_mm + self.step_mm)
        self.changes += 1
        self._begun = lane_mm, self.changes
        return lane_mm

    def again(self) -> None:
        """The stroke that began last has broken off: the next goes where it went, unless told otherwise."""
        if self._begun is not None and self._begun[1] == self.changes:
            self.next_mm = self._begun[0]
            self.changes += 1

    def restart(self) -> None:
        """Another visit: its first stroke lies in the middle."""
        self.next_mm = 0.0
        self.changes += 1

    def as_dict(self) -> dict[str, float | bool]:
        """For the page."""
        return {
            "told": self.told,
            "next_mm": self.next_mm,
            "step_mm": self.step_mm,
            "changes": self.changes,
        }


def mark_of(lane_mm: float, started_s: float) -> str:
    """What a recording is told of a stroke: its lane, and by the probe's time which stroke."""
    return f"lane {lane_mm:g} mm, stroke of {started_s:.3f} s"


def lane_of(mark: str) -> tuple[float, float] | None:
    """The lane that a mark tells and the start of its stroke; None where it tells something else."""
    found = _MARK.fullmatch(mark)
    return None if found is None else (_rounded(float(found[1])), float(found[2]))


def _rounded(lane_mm: float) -> float:
    """To hundredths, as a mark tells it, and not beyond the table."""
    return round(min(max(lane_mm, -MOST_MM), MOST_MM), 2)
