"""The strokes of a session, recorded or live, as the inversion takes them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from firmware_py import calib, messages
from palpate import models
from palpate.errors import RecordingError
from palpate.inversion.felt import FeltStroke, NotInvertible, felt_stroke
from palpate.inversion.start import Start, start_of
from palpate.recording.channels import CALIBRATION
from palpate.recording.playback import open_recording
from palpate.stroke.presses import Presses
from palpate.wire.events import Estimate, Event, Frame, StrokeState

_KEPT = 1 << 16


def felt_strokes(path: str | Path) -> Iterator[tuple[FeltStroke | NotInvertible, Start]]:
    """Every stroke of a recording with a first estimate, or the reason why it cannot be inverted.

    Raises
    ------
    PalpateError
        The file is no readable recording, is of another sensor array, or holds no stroke.
    """
    strokes, count = Strokes(), 0
    moved = set[tuple[int, int]]()
    with open_recording(path) as session:
        calibration = session.recording.attachment(CALIBRATION) or b""
        for event in session.events():
            if isinstance(event, Frame) and len(moved) < 2:
                moved.add((event.position_um, event.displacement_um))
            if (stroke := strokes.take(event, calibration)) is not None:
                count += 1
                yield stroke
    if not count and len(moved) == 1:
        raise RecordingError(
            f"{path} holds a press without place and depth, as other people's arrays send it; what is fitted "
            "is a stroke, for one image does not tell a large deep lump from a small shallow one"
        )
    if not count:
        raise RecordingError(f"{path} holds no whole stroke")


class Strokes:
    """Watches the events of a session go by, and gives each stroke when its estimate has come.

    Raises
    ------
    RecordingError
        No bundled model, where an inversion begins, is of this sensor array.
    """

    def __init__(self) -> None:
        if not models.suits_array():
            raise RecordingError(
                "the inversion starts from a bundled model, and there is none for this sensor array"
            )
        self._presses, self._frames = Presses(), dict[int, Frame]()

    def take(self, event: Event, calibration: bytes) -> tuple[FeltStroke | NotInvertible, Start] | None:
        """The stroke that ends with this event, or why it cannot be inverted, and a first estimate.

        Parameters
        ----------
        calibration : bytes
            What the probe keeps of its own; b"" where it has none.
        """
        if isinstance(event, StrokeState):
            self._presses.take(event)
        elif isinstance(event, Frame):
            self._frames[event.seq] = event
            if len(self._frames) > _KEPT:
                del self._frames[next(iter(self._frames))]
        elif isinstance(event, Estimate):
            own = calib.Calibration()
            own.load(calibration)
            press = self._presses.of(event.stream, event.stroke, self._frames)
            return _of(event, self._frames, press or [], own)
        return None


def _of(
    said: Estimate, frames: dict[int, Frame], press: list[Frame], own: calib.Calibration
) -> tuple[FeltStroke | NotInvertible, Start]:
    numbers = [(said.first_seq + k) % messages.WRAP for k in range(said.frames)]
    stroke = [frames[seq] for seq in numbers if seq in frames]
    nothing = Start(said.stroke, 11.0, 6.0, 11.0, 0.3, 11.0, 0.0)
    if len(stroke) < len(numbers):
        missing = len(numbers) - len(stroke)
        return NotInvertible(
            f"{missing} of the {len(numbers)} frames of stroke {said.stroke} are missing"
        ), nothing
    try:
        felt = _felt(said.stroke, press, stroke)
    except NotInvertible as error:
        return error, nothing
    middle = float(np.mean(felt.place_mm[felt.press :]))
    start = start_of(
        said.stroke,
        ([f.packed for f in press], [f.displacement_um for f in press]),
        ([f.packed for f in stroke], [f.position_um for f in stroke], [f.displacement_um for f in stroke]),
        own,
        middle,
    )
    return felt, start


def _felt(number: int, press: list[Frame], stroke: list[Frame]) -> FeltStroke:
    both = [*press, *stroke]
    if not stroke:
        raise NotInvertible(f"stroke {number} has no frames")
    counts = np.array([frame.counts for frame in both])
    return felt_stroke(
        np.array([frame.pressure_kPa for frame in both], float),
        (counts == 0).all(0),
        np.array([frame.displacement_mm for frame in both]),
        np.array([frame.position_mm for frame in both]),
        np.array([frame.time_us * 1e-6 for frame in both]),
        len(press),
        number,
    )
