"""What a probe's sensors read of strokes over kept solid lumps, for the page."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from firmware_py.calib import Calibration
from palpate.regression.balls.lumps import SET, SolidLump, beside, prepare
from palpate.sim.probe.packed_frames import FrameStream
from palpate.sim.probe.sensors import LEVELS, PRESS_FRAMES, SensorModel, StrokeField

KEPT = Path(__file__).parents[2] / "sim" / "tissue" / "data"
SEED = 5


@cache
def _kept() -> list[SolidLump]:
    assert (KEPT / SET).exists()
    return prepare(KEPT, 1)


def clear_beside() -> SolidLump:
    """The kept lump farthest beside the line among those that are not deep."""
    return max((k for k in _kept() if k.case.depth_mm < 10), key=lambda k: k.case.offset_mm)


def clear_on_line() -> SolidLump:
    """The stiffest kept lump under the line that is not deep, and stroked as hard as a model wants it."""
    clear = [k for k in _kept() if k.case.depth_mm < 10 and k.case.offset_mm == 0 and k.case.F_N_per_m > 35]
    return min(clear, key=lambda k: k.case.E_inv23)


def felt(lump: SolidLump, frames: int, *, turned: bool = False, noise: str = "typical") -> FrameStream:
    """One stroke with its press by a steady hand; turned, the lump lies on the other side of the line."""
    field, pressed = (
        StrokeField(*(beside(stroke) if turned else stroke for stroke in some))
        for some in (lump.strokes.strokes, lump.press)
    )
    return _sensors(field, noise).stroke(frames, press=PRESS_FRAMES, pressed=pressed)


def calibration(noise: str = "typical") -> Calibration:
    """Of the probe that felt them: one seed, one probe."""
    lump = clear_on_line()
    return _sensors(StrokeField(*lump.strokes.strokes), noise).calibration()


def _sensors(field: StrokeField, noise: str) -> SensorModel:
    return SensorModel(field, LEVELS[noise].without("force"), SEED)
