"""Strokes, grouped into visits. Not locked: the session holds its lock round every call."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from palpate.answer.visit import visit_answer
from palpate.stroke.change import ASSUMES, ASSUMES_BETWEEN, QUANTITIES, Between, compare, spread
from palpate.stroke.found_lump import FoundLump
from palpate.stroke.lanes import Lanes
from palpate.stroke.stroke import FollowedStroke

MAX_STROKES = 1000
STROKES_WITH_IMAGES = 100


@dataclass
class Visit:
    """Strokes over the same lump on one occasion."""

    number: int
    name: str
    wall_time: float = field(default_factory=time.time)
    earlier: bool = False


class Visits:
    """All visits of a session; new strokes go into the current one.

    Parameters
    ----------
    first : the first visit's name
    fat_kPa : the fat's modulus, where it is known
    """

    def __init__(self, first: str, fat_kPa: float | None = None) -> None:
        self._fat_kPa = fat_kPa
        self.between: Mapping[str, Between] = {}
        """What visits differ by themselves, by quantity, where a data set has told it."""
        self._visits = [Visit(1, first)]
        self._current = self._visits[0]
        self._strokes: list[FollowedStroke] = []
        self._next_stroke = 1
        self.lanes = Lanes()

    def new_stroke(self, started_s: float) -> FollowedStroke:
        """A stroke that has just begun; `add` it when it is over (one that breaks off leaves no number
        out)."""
        number, visit = self._next_stroke, self._current.number
        return FollowedStroke(number=number, visit=visit, started_s=started_s, lane_mm=self.lanes.begin())

    def add(self, stroke: FollowedStroke) -> None:
        """Number and keep a finished stroke; the oldest give way beyond a thousand."""
        stroke.number, stroke.fat_kPa = self._next_stroke, self._fat_kPa
        self._next_stroke += 1
        self._strokes.append(stroke)
        if len(self._strokes) > STROKES_WITH_IMAGES:
            self._strokes[-STROKES_WITH_IMAGES - 1].drop_images()
        del self._strokes[:-MAX_STROKES]

    def adopt(self, stroke: FollowedStroke) -> None:
        """Keep a stroke that was put together elsewhere, in the current visit."""
        stroke.visit = self._current.number
        self.add(stroke)

    def at(self, started_s: float) -> FollowedStroke | None:
        """The stroke of the current visit that started at this time of the probe (to a tenth of a second)."""
        visit = self.strokes(self._current.number)
        return next((s for s in visit if abs(s.started_s - started_s) < 0.1), None)

    def same(self, stroke: FollowedStroke) -> FollowedStroke | None:
        """The kept stroke that this one is (it may have been seen in part only): the same estimate, or
        start."""
        if stroke.estimate is None:
            return self.at(stroke.started_s)
        told = stroke.estimate
        visit = self.strokes(self._current.number)
        return next((s for s in visit if s.estimate is not None and s.estimate.time_us == told.time_us), None)

    def get(self, number: int) -> FollowedStroke | None:
        """The stroke with this number."""
        return next((s for s in self._strokes if s.number == number), None)

    def strokes(self, visit: int | None = None) -> list[FollowedStroke]:
        """All strokes, or those of one visit, oldest first."""
        return [s for s in self._strokes if visit is None or s.visit == visit]

    def start(self, name: str) -> Visit:
        """A new visit; strokes go there from now on."""
        self._current = self._append(name)
        self.lanes.restart()
        return self._current

    def add_earlier(self, name: str, strokes: Sequence[FollowedStroke]) -> Visit:
        """A visit from an earlier recording, to compare with."""
        visit = self._append(name)
        visit.earlier = True
        if strokes:
            visit.wall_time = strokes[0].wall_time
        for stroke in strokes:
            stroke.visit = visit.number
            self.add(stroke)
        return visit

    def snapshot(self) -> dict[str, Any]:
        """Visits and one line for each stroke."""
        return {
            "visits": [{**asdict(v), "answer": self.answer(v.number)} for v in self._visits],
            "current_visit": self._current.number,
            "strokes": [s.summary() for s in self._strokes],
            "lanes": self.lanes.as_dict(),
        }

    def answer(self, visit: int) -> dict[str, Any] | None:
        """What the strokes of a visit over one lump say together; None of fewer than two.

        Where lanes are told a visit may hold several lumps: those count that meet the last sure one's.
        """
        strokes = self.strokes(visit)
        if any(s.lane_mm is not None for s in strokes):
            strokes = same_lump(strokes)
        found = visit_answer([(s.estimate, s.told) for s in strokes])
        if found is None:
            return None
        words = found.stiffness_words(self._fat_kPa)
        return {**found.as_dict(), "stiffness_text": words, "numbers": [s.number for s in strokes]}

    def repeatability(self, visit: int, last: int) -> dict[str, Any]:
        """Mean and spread of the last strokes of a visit, for every quantity that the cards vouch for."""
        strokes = [s for s in self.strokes(visit) if s.value("d_mm") is not None][-max(last, 1) :]
        out: dict[str, Any] = {"visit": visit, "last": last, "used": [s.number for s in strokes]}
        for key in QUANTITIES:
            found = spread([v for s in strokes if (v := s.value(key)) is not None])
            out[key] = None if found is None else asdict(found)
        return out

    def compare(self, a: int, b: int) -> dict[str, Any]:
        """Visit `b` against visit `a`, quantity by quantity."""
        out: dict[str, Any] = {"a": a, "b": b, "assumes": ASSUMES_BETWEEN if self.between else ASSUMES}
        for key, (what, unit) in QUANTITIES.items():
            values = [[v for s in self.strokes(n) if (v := s.value(key)) is not None] for n in (a, b)]
            found = compare(values[0], values[1], what=what, unit=unit, between=self.between.get(key))
            out[key] = None if found is None else asdict(found)
        return out

    def has(self, visit: int) -> bool:
        """Is there such a visit?"""
        return any(v.number == visit for v in self._visits)

    def _append(self, name: str) -> Visit:
        visit = Visit(len(self._visits) + 1, name)
        self._visits.append(visit)
        return visit


def same_lump(strokes: Sequence[FollowedStroke]) -> list[FollowedStroke]:
    """The strokes whose lump lies where the last one's does, within half a diameter along and across."""
    found = [(s, lump) for s in strokes if s.lane_mm is not None and (lump := s.lump()) and lump.sure]
    if not found:
        return []
    last, there = found[-1]
    near_mm = there.d_mm[0] / 2

    def across_mm(stroke: FollowedStroke, lump: FoundLump) -> float:
        return (stroke.lane_mm or 0.0) + (lump.across_mm[0] if lump.across_mm else 0.0)

    return [
        s
        for s, lump in found
        if abs(lump.along_mm - there.along_mm) <= near_mm
        and abs(across_mm(s, lump) - across_mm(last, there)) <= near_mm
    ]
