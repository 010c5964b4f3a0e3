"""The strokes of a session, recorded or live, as the inversion takes them, and its presses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_py import calib
from palpate import models
from palpate.errors import RecordingError
from palpate.inversion.felt import FeltStroke, NotInvertible, felt_press, felt_stroke
from palpate.inversion.start import MIDDLE, Start, first_guess, start_of
from palpate.link.face import Face, face_at
from palpate.link.schemes import address_of
from palpate.recording.channels import CALIBRATION
from palpate.recording.playback import open_recording
from palpate.stroke.session_frames import SessionFrames, StrokeFrames
from palpate.wire.events import Estimate, Event, Frame, StrokeState

Floats = NDArray[np.float64]

_CURVE_KPA = 0.05
"""Of a cell's curve through three points, as the emulated FlexiTac's have it: 0.02 to 0.08 kPa."""

Felt = tuple[FeltStroke | NotInvertible, Start]


def felt_strokes(path: str | Path, face: Face | None = None) -> Iterator[Felt]:
    """Every stroke of a recording with a first estimate, or the reason why it cannot be inverted.

    Where it holds no stroke, every press.

    Parameters
    ----------
    face : Face, optional
        Of somebody's array; by default what the recorded port says of it.

    Raises
    ------
    PalpateError
        The file is no readable recording, is of another sensor array, or holds neither stroke nor press.
    """
    presses: list[Felt] = []
    count = 0
    with open_recording(path) as session:
        port = session.recording.metadata().get("session", {}).get("port", "")
        strokes = FeltStrokes(port, face)
        calibration = session.recording.attachment(CALIBRATION) or b""
        for event in session.events():
            if (found := strokes.take(event, calibration)) is None:
                continue
            if strokes.was_press:
                presses.append(found)
            else:
                count += 1
                yield found
        if (found := strokes.end()) is not None:
            presses.append(found)
    if not count:
        yield from presses
    if not count and not presses:
        raise RecordingError(f"{path} holds no whole stroke, and no press")


class FeltStrokes:
    """Watches the events of a session go by, and gives each stroke and each press alone when it is over.

    Parameters
    ----------
    port : str
        Where the session came from: somebody's array must be described and calibrated.
    face : Face, optional
        What describes it, where the port does not.

    Attributes
    ----------
    was_press : bool
        Whether what `take` gave last was a press alone.
    """

    def __init__(self, port: str = "", face: Face | None = None) -> None:
        address = address_of(port)
        self._foreign = address is not None
        self._face = face or face_at(address)
        self._frames = SessionFrames()
        self._contact: int | None = None
        self._newest, self._pressed = 0, 0
        self.was_press = False

    def take(self, event: Event, calibration: bytes) -> Felt | None:
        """The stroke or press that ends with this event, or why it cannot be inverted, and a first estimate.

        Parameters
        ----------
        calibration : bytes
            What the probe keeps of its own; b"" where it has none.
        """
        self._calibration = calibration
        self._frames.take(event)
        if isinstance(event, StrokeState):
            if event.state == "lifted":
                return self.end()
            if event.state in ("contact", "started"):
                self._contact = event.frame_seq if event.state == "contact" else None
        elif isinstance(event, Frame):
            self._newest = event.seq
        elif isinstance(event, Estimate):
            self.was_press = False
            own = calib.Calibration()
            own.load(calibration)
            if (problem := self._problem()) is not None:
                return problem, replace(MIDDLE, stroke=event.stroke)
            found, start = _of(event, self._frames.of(event), own, self._face)
            return self._curved(found), start
        return None

    def end(self) -> Felt | None:
        """The press that is under way, which ends here."""
        first, self._contact = self._contact, None
        if first is None:
            return None
        self.was_press, self._pressed = True, self._pressed + 1
        nothing = replace(MIDDLE, stroke=self._pressed)
        if (problem := self._problem()) is not None:
            return problem, nothing
        try:
            felt = felt_press(*_read(self._frames.between(first, self._newest)), self._pressed, self._face)
        except NotInvertible as error:
            return error, nothing
        return self._curved(felt), first_guess(felt)

    def _curved(self, felt: FeltStroke | NotInvertible) -> FeltStroke | NotInvertible:
        """With what the curves of somebody's array miss."""
        if isinstance(felt, NotInvertible) or not self._foreign:
            return felt
        return replace(felt, curve_kPa=_CURVE_KPA)

    def _problem(self) -> NotInvertible | None:
        """Why nothing of somebody's array can be inverted."""
        if self._foreign and not self._calibration:
            return NotInvertible(
                "its pressures are a guess until the array is calibrated: palpate calibrate zero, then gain, "
                "and record again"
            )
        if self._foreign and self._face is None:
            return NotInvertible(
                "the array's face is not described: say --face radius=flat, or "
                "--face 'radius=40mm&padding=2mm&modulus=80kPa'"
            )
        return None


def _of(said: Estimate, frames: StrokeFrames, own: calib.Calibration, face: Face | None) -> Felt:
    nothing = replace(MIDDLE, stroke=said.stroke)
    stroke, press = frames.stroke, frames.press or []
    if frames.missing:
        problem = f"{frames.missing} of the {said.frames} frames of stroke {said.stroke} are missing"
        return NotInvertible(problem), nothing
    if not stroke:
        return NotInvertible(f"stroke {said.stroke} has no frames"), nothing
    try:
        pressure, dead, depth, time_s = _read([*press, *stroke])
        place = np.array([frame.position_mm for frame in (*press, *stroke)])
        felt = felt_stroke(pressure, dead, depth, place, time_s, len(press), said.stroke, face)
    except NotInvertible as error:
        return error, nothing
    if face is not None or not models.suits_array():
        return felt, first_guess(felt)  # no bundled model knows such a face
    middle = float(np.mean(felt.place_mm[felt.press :]))
    start = start_of(
        said.stroke,
        ([f.packed for f in press], [f.displacement_um for f in press]),
        ([f.packed for f in stroke], [f.position_um for f in stroke], [f.displacement_um for f in stroke]),
        own,
        middle,
        models.BALLS if felt.solid else models.ANYWHERE,
    )
    return felt, start


def _read(frames: list[Frame]) -> tuple[Floats, NDArray[np.bool_], Floats, Floats]:
    """Pressures, dead cells, displacements and times of n frames."""
    counts = np.array([frame.counts for frame in frames])
    return (
        np.array([frame.pressure_kPa for frame in frames], float),
        (counts == 0).all(0),
        np.array([frame.displacement_mm for frame in frames]),
        np.array([frame.time_us * 1e-6 for frame in frames]),
    )
