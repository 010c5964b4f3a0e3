"""What a probe's sensors read of strokes over kept solid lumps, for the page."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from firmware_py.calib import Calibration
from palpate.learn.lumps import LumpStrokes, beside, read_solids
from palpate.sim.probe.packed_frames import FrameStream
from palpate.sim.probe.sensors import LEVELS, PRESS_FRAMES, SensorModel, StrokeField
from palpate.sim.tissue import Case

KEPT = Path(__file__).parents[2] / "sim" / "tissue" / "data"
SEED = 5


@cache
def _shallow() -> list[LumpStrokes]:
    """Those that are stiff, not deep, and stroked as hard as a model wants it."""
    return [k for k in read_solids(KEPT) if _is_clear(k.case)]


def _is_clear(case: Case) -> bool:
    return case.depth_mm < 9 and case.d_mm > 7 and case.E_inv23 < 0.35 and case.F_N_per_m > 35


def clear_beside() -> LumpStrokes:
    """The clear lump farthest beside the line."""
    return max(_shallow(), key=lambda k: k.case.offset_mm)


def clear_on_line() -> LumpStrokes:
    """The stiffest clear lump under the line."""
    under = [k for k in _shallow() if k.case.offset_mm == 0]
    return min(under, key=lambda k: k.case.E_inv23)


def felt(lump: LumpStrokes, frames: int, *, turned: bool = False, noise: str = "typical") -> FrameStream:
    """One stroke with its press by a steady hand; turned, the lump lies on the other side of the line."""
    field, pressed = (
        StrokeField(*(beside(stroke) if turned else stroke for stroke in some))
        for some in (lump.strokes, lump.press)
    )
    return _sensors(field, noise).stroke(frames, press=PRESS_FRAMES, pressed=pressed)


def calibration(noise: str = "typical") -> Calibration:
    """Of the probe that felt them: one seed, one probe."""
    lump = clear_on_line()
    return _sensors(StrokeField(*lump.strokes), noise).calibration()


def _sensors(field: StrokeField, noise: str) -> SensorModel:
    return SensorModel(field, LEVELS[noise].without("force"), SEED)
