"""A probe on a port as a source of events. The link itself reconnects; this module reports it to the page."""

from __future__ import annotations

import threading
import time
from collections import deque
from pathlib import Path

from firmware_py import messages
from palpate.errors import LinkError, PortAmbiguous, PortMissing, RecordingError, VersionMismatch
from palpate.link.devices import resolve
from palpate.link.flash import flash
from palpate.link.probe import Probe
from palpate.model_export.check_image import check_image
from palpate.model_export.schema import ModelSpec
from palpate.recording.channels import CALIBRATION, MODEL
from palpate.recording.writer import RecordingWriter
from palpate.stroke.answered import AnsweredEvents
from palpate.stroke.documents import Documents
from palpate.stroke.follower import Follower
from palpate.view.latency import Latency
from palpate.view.live_recorder import LiveRecorder
from palpate.view.notices import Health, LinkChanged, LinkState, OtherEnd, RecordingStopped, sentence
from palpate.view.source import Emit
from palpate.wire.events import MARK_PREFIX, Frame, Gap, Log
from palpate.wire.reference import Reference
from palpate.wire.source import EventSource

HEALTH_EVERY_S = 0.5
RETRY_S = 1.0
SILENCE_S = 0.1
LOOK_ELSEWHERE_S = 2.0
"""With `--port auto`: a probe that has been gone for so long may have been replaced by another."""
_GONE = "The probe is gone. Plug it in again; this page goes on by itself."


class LiveSource:
    """A probe by its port, as `palpate --port` takes it; keeps looking for one that is not there.

    Parameters
    ----------
    port : str
        A device path, `COM5`, `socket://HOST:PORT`, a serial number, or `auto`.
    document : ModelSpec, optional
        Of the probe's model, where it is none that comes with Palpate.
    """

    def __init__(self, port: str, document: ModelSpec | None = None) -> None:
        self.name = port
        self._documents = Documents(document)
        self._port = port
        self._recorder = LiveRecorder()
        self._probe: Probe | None = None
        self._last_us = 0
        self._rate: deque[tuple[float, int]] = deque(maxlen=8)
        self._emit: Emit = lambda event: None
        self._follower: Follower | None = None

    @property
    def calibration(self) -> bytes:
        """What the probe keeps of its own; b"" where it has none."""
        return b"" if self._follower is None else self._follower.calibration

    # ---- recording

    @property
    def recording(self) -> bool:
        """Is a file being written?"""
        return self._recorder.writer is not None

    @property
    def recorded_to(self) -> Path | None:
        """The file that is recorded to."""
        writer = self._recorder.writer
        return None if writer is None else writer.path

    def start_recording(self, path: Path) -> None:
        """Record from now on; the file begins with the probe's identity, model and calibration."""
        writer = RecordingWriter(path, metadata={"source": self._port, "by": "palpate view"})
        self._recorder.writer = writer
        if (probe := self._probe) is not None and probe.connected:
            try:
                probe.refresh_identity()  # its answer goes into the file: a recording needs a handshake
                probe.renew_stream()  # and so does this one: it says which stream the file is of
                probe.reference()  # and this one: what joins the strokes
                for name, what in ((MODEL, messages.READ_MODEL), (CALIBRATION, messages.READ_CALIBRATION)):
                    if blob := probe.read_back(what):
                        writer.attach(name, "application/octet-stream", blob)
            except LinkError:
                pass  # the probe has just gone: the link reports it, and the recording goes on later

    def stop_recording(self) -> None:
        """Close the file; raises `RecordingError` with the reason if it ended early (a full disk)."""
        writer = self._recorder.writer
        if writer is None or not self._recorder.give_up(writer):
            return
        writer.close()
        writer.check()

    def mark(self, text: str) -> None:
        """A line in the recording's log."""
        self._recorder.mark(Log(time.time_ns(), 0, self._last_us, MARK_PREFIX + text))

    def check_recording(self, emit: Emit) -> None:
        """Report at once a recording that has ended by itself (a full disk): nobody should go on stroking in
        vain."""
        writer = self._recorder.writer
        if writer is None:
            return
        try:
            writer.check()
        except RecordingError as error:
            if not self._recorder.give_up(writer):
                return  # it has just been stopped, and its end reported
            writer.close()
            emit(RecordingStopped(f"The recording has stopped: {error}."))

    # ---- the model

    def flash(self, image: bytes) -> str:
        """Put a model image onto the probe, in a pause of the stream; the id of the model that is live
        then."""
        check_image(image)
        probe = self._connected("put it on")
        probe.stop_stream()
        try:
            done = flash(probe, image)
            self._documents.learn(image)
        finally:
            probe.start_stream()
        self._tell(probe)
        return done.model_id

    # ---- the reference press

    def take_reference(self) -> str:
        """Wait for a press beside the lump, in a pause of the stream; what it says, in words."""
        probe = self._connected("press")
        probe.stop_stream()
        try:
            return words_of(probe.take_reference())
        finally:
            probe.start_stream()
            self._tell(probe)

    def forget_reference(self) -> None:
        """The strokes to come go without it."""
        probe = self._connected("forget a reference press on")
        probe.clear_reference()
        self._tell(probe)

    def _connected(self, what: str) -> Probe:
        probe = self._probe
        if probe is None or not probe.connected:
            raise PortMissing(self._port, f"there is no probe to {what}; plug it in first")
        return probe

    # ---- the thread

    def run(self, emit: Emit, stop: threading.Event) -> None:
        """Open the probe, pass on its events, start over when it is gone; see `Source`."""
        self._emit = emit
        state = LinkState.CONNECTING
        while not stop.is_set():
            try:
                with Probe.open(self._port, recorder=self._recorder) as probe:
                    self._probe = probe
                    state = LinkState.GONE
                    self._follow(probe, emit, stop)
            except LinkError as error:
                text = _GONE if state is LinkState.GONE else f"{sentence(error)} Trying again every second."
                emit(LinkChanged(state, text))
                if isinstance(error, PortAmbiguous | VersionMismatch):
                    stop.wait(5.0)
            finally:
                self._probe = None
            stop.wait(RETRY_S)

    def _follow(self, probe: Probe, emit: Emit, stop: threading.Event) -> None:
        answers = AnsweredEvents(follower := Follower(self._documents))
        follower.meet(probe)
        self._follower = follower
        probe.reference()  # it may have been taken before this page was opened
        self.name = self._tell(probe).serial or self._port
        latency = Latency()
        latency.sync(probe)
        probe.start_stream()
        told = 0.0
        gone_at: float | None = None
        while not stop.is_set():
            if gone_at is not None and time.monotonic() - gone_at > LOOK_ELSEWHERE_S:
                gone_at = time.monotonic()
                if self._elsewhere():
                    return
            for event in probe.events(timeout_s=SILENCE_S):
                if isinstance(event, Frame):
                    self._last_us = event.time_us
                    latency.add(event)
                for each in answers.feed(event):
                    emit(each)
                if isinstance(event, Gap):
                    latency.restart()
                    gone_at = None if event.ended else time.monotonic()
                    if event.ended:
                        follower.meet(probe)
                        probe.reference()
                        self._tell(probe)
                    else:
                        emit(LinkChanged(LinkState.GONE, _GONE))
                    continue
                if stop.is_set() or time.monotonic() - told > HEALTH_EVERY_S:
                    break
            if time.monotonic() - told > HEALTH_EVERY_S:
                told = time.monotonic()
                emit(self._health(probe, latency.median_ms))
                self.check_recording(emit)
                if probe.connected:
                    latency.sync(probe)
        if probe.connected:
            probe.stop_stream()

    def _tell(self, probe: Probe) -> OtherEnd:
        """Tell the page that the probe is there, and which it is."""
        device = describe(probe, self._documents)
        self._emit(LinkChanged(LinkState.CONNECTED, "Connected.", device))
        return device

    def _elsewhere(self) -> bool:
        """Is there another probe than the one that has gone, where any would do? A restarted emulator, a
        replaced board."""
        if self._port != "auto":
            return False
        try:
            resolve("auto")
        except LinkError:
            return False
        return True

    def _health(self, probe: Probe, latency_ms: float | None) -> Health:
        frames, counts = probe.frame_counts, probe.counts
        now = time.monotonic()
        self._rate.append((now, frames.received))
        (then, before), span = self._rate[0], now - self._rate[0][0]
        return Health(
            frames_per_s=(frames.received - before) / span if span > 0.2 and then < now else 0.0,
            lost=frames.lost,
            crc_errors=counts.bad_crc,
            resent=counts.resent,
            latency_ms=latency_ms,
        )


def describe(source: EventSource, documents: Documents) -> OtherEnd:
    """Who answers, for the page's head."""
    identity = source.identity
    return OtherEnd(
        name="Probe" if source.live else Path(source.name).name,
        serial=readable(identity.serial),
        firmware=identity.firmware,
        runtime=source.name if source.live else "",
        model_id=identity.model_id if identity.model_status == 0 else "",
        damaged=identity.damaged,
        reference=_reference_of(source),
        force_range=None if documents.answering is None else documents.answering.force_range,
        document=documents.remark,
    )


def _reference_of(source: EventSource) -> str | None:
    if not source.live or "takes_reference" not in source.identity.capabilities:
        return None
    kept = source.kept_reference
    return "" if kept is None else words_of(Reference.of_kept(kept))


def words_of(reference: Reference) -> str:
    """What a reference press says, for people."""
    return f"fat of {reference.E_fat_kPa:.1f} kPa, {reference.t_mm:.1f} mm thick"


def readable(serial: str) -> str:
    """A serial number as text where its bytes are printable, else in hexadecimal."""
    try:
        text = bytes.fromhex(serial).rstrip(b"\0").decode("ascii")
    except ValueError:
        return serial
    return text if text.isprintable() and text.strip() else serial
