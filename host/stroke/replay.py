"""Replaying a recording: its bytes through the live parser, its frames through the probe's integer code.

The same source that ran on the probe (`firmware_py`) runs here, so the estimate must come out equal to the
last bit; where frames of a stroke are missing, or the model is not known, that is said instead.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_py import calib, evaluator, feature_names, features, outputs, pipeline, status
from firmware_py.estimator import answer
from palpate.answer import NOTHING_TOLD, probe_dict
from palpate.errors import RecordingError
from palpate.model_export.vocabulary import OF_THE_PRESS
from palpate.recording.channels import CALIBRATION, MODEL
from palpate.recording.playback import open_recording
from palpate.recording.reader import Recording
from palpate.stroke.documents import Documents
from palpate.stroke.follower import Follower
from palpate.stroke.session_frames import SessionFrames, StrokeFrames
from palpate.wire.events import Estimate, Features

if TYPE_CHECKING:
    from palpate.answer.told import Told


@dataclass(frozen=True)
class ReplayedStroke:
    """One stroke: what the probe said, and what its frames say here.

    Parameters
    ----------
    probe : Estimate
        As it came over the wire.
    host : Estimate or None
        Worked out here; None where `missing` says why not.
    features_equal : bool or None
        Whether the features agree bit for bit, those of the press where its frames are there; None where the
        probe sent none.
    missing : str
        Why there is no comparison; "" where there is one.
    told : Told or None
        What the host adds, where the model's document tells of it.
    """

    probe: Estimate
    host: Estimate | None
    features_equal: bool | None
    missing: str = ""
    told: Told | None = None

    @property
    def alone(self) -> bool:
        """Whether the probe had no model: the estimate worked out here is the only one."""
        return self.host is not None and not any(self.probe.model_id)

    @property
    def answer(self) -> Estimate:
        """The probe's estimate; the one worked out here where it had no model."""
        return self.host if self.host is not None and self.alone else self.probe

    @property
    def identical(self) -> bool:
        """True where every integer of the estimate (and of the features) is the same."""
        if self.host is None or self.alone or self.features_equal is False:
            return False
        return self.host.numbers == self.probe.numbers

    def as_dict(self) -> dict[str, Any]:
        """The stroke as `--json` prints it."""
        told = self.told if self.identical else None  # it is of what the probe said
        return {
            "stroke": self.probe.stroke,
            "identical": self.identical,
            "missing": self.missing,
            "estimate": probe_dict(self.probe, self.told),
            **(NOTHING_TOLD if self.told is None else self.told.as_dict()),
            "replayed": None if self.host is None else probe_dict(self.host, told),
        }


class Replayer:
    """The probe's computation, from frames to estimate, with its calibration and its model.

    Parameters
    ----------
    model : bytes
        The model image.
    calibration : bytes
        The probe's stored calibration; b"" is the one it has from birth.

    Raises
    ------
    RecordingError
        Either cannot be used.
    """

    def __init__(self, model: bytes, calibration: bytes = b"") -> None:
        from palpate.model_export.check_image import check_image
        from palpate.model_export.image_builder import inspect

        check_image(model, "the recording's own estimates stay as they are")
        self.model = inspect(model).model
        own = calib.Calibration()
        if calibration and own.load(calibration) != status.OK:
            raise RecordingError("the recording's calibration cannot be read; record the stroke again")
        self._pipeline = pipeline.Pipeline(own)
        self._out = array("i", bytes(4 * evaluator.OUT_SIZE))

    @property
    def needs_press(self) -> bool:
        """Whether the model looks at the press before a stroke."""
        tables, stages = self.model.tables, (self.model.first, self.model.checks)
        used = {*tables.ids, *tables.limits[::3], *(i for stage in stages if stage for i in stage.ids)}
        return any(i < features.COUNT and feature_names.NAMES[i] in OF_THE_PRESS for i in used)

    def estimate(
        self,
        said: Estimate,
        frames: StrokeFrames,
        reference: tuple[int, int, int] | None,
    ) -> tuple[Estimate, tuple[int, ...]]:
        """The estimate and the features of a stroke's frames.

        Parameters
        ----------
        said : Estimate
            The probe's own, for the stroke's number and place.
        frames : StrokeFrames
            All that it rests on.
        reference : (int, int, int) or None
            What the probe kept of a reference press.
        """
        if (first := self.model.first) is not None:
            first.held = False
            if reference is not None and first.refers and _met_reference(said):
                first.set(*reference)
        p = self._pipeline
        code = frames.push(p, self.model.force_map)
        code, flags, level, distance, values = answer(code, self.model, p.features, self._out)
        own = Estimate(
            said.host_ns,
            said.stream,
            said.stroke,
            code,
            flags,
            said.damage,
            level,
            distance,
            self.model.model_id,
            len(frames.stroke),
            said.first_seq,
            said.last_seq,
            said.overrun,
            said.time_us,
            tuple(values),
        )
        return own, tuple(p.features)


def replay(
    path: str | Path, model: bytes | None = None, documents: Documents | None = None
) -> Iterator[ReplayedStroke]:
    """Replay every stroke of a recording.

    Parameters
    ----------
    path : str or Path
        The recording.
    model : bytes, optional
        A model image to use instead of the recorded one.
    documents : Documents, optional
        Where the model's document has been looked up already; by default it is one that comes with Palpate.

    Yields
    ------
    ReplayedStroke

    Raises
    ------
    NotARecording, NoSuchFile, RecordingError
    """
    recording = Recording(path)
    image = model or recording.attachment(MODEL)
    replayer = Replayer(image, recording.attachment(CALIBRATION) or b"") if image else None
    if documents is None:
        documents = Documents()
        documents.learn(image or b"")
    follower = Follower(documents, recording.attachment(CALIBRATION) or b"")
    frames = SessionFrames()
    told: dict[int, tuple[int, ...]] = {}
    with open_recording(path) as session:
        for event in session.events():
            follower.take(event)
            frames.take(event)
            if isinstance(event, Features):
                told[event.stroke] = event.values
            elif isinstance(event, Estimate):
                known = told.pop(event.stroke, None)
                found = _compare(event, frames.of(event), known, replayer, session.kept_reference)
                yield replace(found, told=follower.of(event))


def _compare(
    said: Estimate,
    frames: StrokeFrames,
    told: tuple[int, ...] | None,
    replayer: Replayer | None,
    reference: tuple[int, int, int] | None,
) -> ReplayedStroke:
    if replayer is None:
        why = "the recording holds no model image; give one with --model"
        return ReplayedStroke(said, None, None, why)
    if frames.missing:
        why = f"{frames.missing} of the stroke's {said.frames} frames are missing"
        return ReplayedStroke(said, None, None, why)
    if any(said.model_id) and replayer.model.model_id != said.model_id:
        held, used = replayer.model.model_id.hex(), said.model_id.hex()
        why = f"the probe used model {used}, and this image is {held}"
        return ReplayedStroke(said, None, None, why)
    if frames.press is None and replayer.needs_press:
        why = "frames of the press before the stroke are missing, and the model needs it"
        return ReplayedStroke(said, None, None, why)
    if reference is None and _met_reference(said):
        why = "the recording does not hold the reference press that the probe kept"
        return ReplayedStroke(said, None, None, why)
    estimate, values = replayer.estimate(said, frames, reference)
    equal = None if told is None else _same(told, values, frames.press is not None)
    return ReplayedStroke(said, estimate, equal)


def _met_reference(said: Estimate) -> bool:
    """Whether the probe held a reference when it worked this out."""
    return bool(said.flags & (outputs.REFERENCE | outputs.REFERENCE_OFF))


def _same(told: tuple[int, ...], here: tuple[int, ...], with_press: bool) -> bool:
    """Whether the features are the same: those that the probe knew, which may be older than this program."""
    pairs = zip(feature_names.NAMES, told, here)
    return all(a == b for name, a, b in pairs if with_press or name not in OF_THE_PRESS)
