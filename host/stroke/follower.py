"""Follows a session's events and says, with each estimate, what the host adds to it (`told`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from firmware_py import calib, forcemap, messages, pipeline, status
from palpate.stroke.documents import Documents, ReadBack
from palpate.stroke.session_frames import SessionFrames
from palpate.wire.events import OUTPUTS, Estimate, Event, Features, Gap

if TYPE_CHECKING:
    from palpate.answer.told import Told
    from palpate.model_export.schema import ModelSpec

_STROKES_KEPT = 16


class Follower:
    """Takes every event of a probe's stream, or of a recording.

    Parameters
    ----------
    documents : Documents
        Of the models that it may meet.
    calibration : bytes
        The probe's, as it is stored; b"" is the one it has from birth.
    """

    def __init__(self, documents: Documents, calibration: bytes = b"") -> None:
        self.documents = documents
        self.calibration = calibration
        self._frames = SessionFrames()
        self._features: dict[tuple[int, int], tuple[int, ...]] = {}

    def meet(self, probe: ReadBack) -> None:
        """Ask a probe for its model and its calibration."""
        self.documents.ask(probe)
        self.calibration = probe.read_back(messages.READ_CALIBRATION)

    def take(self, event: Event) -> None:
        """The next event."""
        self._frames.take(event)
        if isinstance(event, Features):
            self._features[event.stream, event.stroke] = event.values
            while len(self._features) > _STROKES_KEPT:
                del self._features[next(iter(self._features))]
        elif isinstance(event, Gap) and event.restarted:
            self._frames.forget()
            self._features.clear()

    def of(self, said: Estimate) -> Told | None:
        """What the model of this estimate tells, or why it is not for this stroke; None where there
        is no lump, or no document tells of it.

        Features are the probe's own, or worked out from the frames of stroke and press if it sent none. The
        place takes all of the stroke's frames, and columns that felt the bump beside others that did not.
        """
        if not (said.lump and said.valid):
            return None
        spec = self.documents.of(said.model_id)
        if spec is None or (said.in_domain and spec.across is None and spec.layers is None):
            return None
        from palpate.answer.told import told  # with numpy, which few commands need

        answer = [said.span(name) for name in OUTPUTS] if len(said.outputs) == len(OUTPUTS) else []
        features = self._features.get((said.stream, said.stroke))
        p = self._pushed(spec, said)
        if p is None:
            return told(spec, features, None, answer, said.in_domain)
        if features is None and p.press_is_whole:
            features = tuple(p.features)
        beside_others = p.span[1] - p.span[0] < len(p.columns)
        return told(spec, features, tuple(p.columns) if beside_others else None, answer, said.in_domain)

    def _pushed(self, spec: ModelSpec, said: Estimate) -> _Pipeline | None:
        """The firmware's pipeline with this stroke pushed through; None if some of its frames are missing."""
        found = self._frames.of(said)
        if not found.stroke or found.missing:
            return None
        calibration = calib.Calibration()
        if self.calibration and calibration.load(self.calibration) != status.OK:
            return None
        p = _Pipeline(calibration)
        p.press_is_whole = found.press is not None
        return p if found.push(p, _force_map(spec)) == status.OK else None


def _force_map(spec: ModelSpec) -> Any:
    from palpate.model_export.integers import force_map as force_maps

    return None if spec.force_map is None else forcemap.load(force_maps.blob(spec.force_map))


class _Pipeline(pipeline.Pipeline):  # type: ignore[misc]
    press_is_whole = False
