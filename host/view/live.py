"""A probe on a port as a source of events. The link itself reconnects; here it is said in words."""

from __future__ import annotations

import threading
import time
from collections import deque
from pathlib import Path

from firmware_py import messages
from host.errors import LinkError, PortAmbiguous, RecordingError, VersionMismatch
from host.link.events import Event as LinkEvent
from host.link.events import Frame as LinkFrame
from host.link.events import Gap, Log
from host.link.probe import Probe
from host.link.scale import CellScale
from host.record.replay import CALIBRATION, MODEL
from host.record.writer import RecordingWriter
from host.view.events import Device, Health, LinkChanged, LinkState, RecordingStopped
from host.view.latency import Latency
from host.view.source import Emit
from host.view.translate import MARK_PREFIX, Translator

HEALTH_EVERY_S = 0.5
RETRY_S = 1.0
SILENCE_S = 0.1
_GONE = "The probe is gone. Plug it in again; this page goes on by itself."


class Recorder:
    """Hands what the link tells on to a recording, while one is running."""

    def __init__(self) -> None:
        self.writer: RecordingWriter | None = None
        self._lock = threading.Lock()

    def give_up(self, writer: RecordingWriter) -> bool:
        """Hand nothing on to this recording any more; False if that is so already."""
        with self._lock:
            if self.writer is not writer:
                return False
            self.writer = None
            return True

    def received(self, raw: bytes, event: LinkEvent | None, host_ns: int) -> None:
        """Bytes from the probe."""
        if (writer := self.writer) is not None:
            writer.received(raw, event, host_ns)

    def sent(self, raw: bytes, host_ns: int) -> None:
        """Bytes to the probe."""
        if (writer := self.writer) is not None:
            writer.sent(raw, host_ns)

    def mark(self, event: LinkEvent) -> None:
        """A gap, or somebody's mark."""
        if (writer := self.writer) is not None:
            writer.mark(event)


class LiveSource:
    """A probe by its port, as `palpate --port` takes it; keeps looking for one that is not there.

    Parameters
    ----------
    port : str
        A device path, `COM5`, `socket://HOST:PORT`, a serial number, or `auto`.
    """

    def __init__(self, port: str) -> None:
        self.name = port
        self._port = port
        self._recorder = Recorder()
        self._probe: Probe | None = None
        self._last_us = 0
        self._rate: deque[tuple[float, int]] = deque(maxlen=8)

    # ---- recording

    @property
    def recording(self) -> bool:
        """Is a file being written?"""
        return self._recorder.writer is not None

    def start_recording(self, path: Path) -> None:
        """Record from now on; the file begins with the probe's identity, model and calibration."""
        writer = RecordingWriter(path, metadata={"source": self._port, "by": "palpate view"})
        self._recorder.writer = writer
        if (probe := self._probe) is not None and probe.connected:
            try:
                probe.refresh_identity()  # its answer goes into the file: a recording needs a handshake
                for name, what in ((MODEL, messages.READ_MODEL), (CALIBRATION, messages.READ_CALIBRATION)):
                    if blob := probe.read_back(what):
                        writer.attach(name, "application/octet-stream", blob)
            except LinkError:
                pass  # the probe has just gone; the link says so, and the recording goes on when it is back

    def stop_recording(self) -> None:
        """Close the file; raises OSError with the reason if it ended early (a full disk)."""
        writer = self._recorder.writer
        if writer is None or not self._recorder.give_up(writer):
            return
        writer.close()
        try:
            writer.check()
        except RecordingError as error:
            raise OSError(str(error)) from error

    def mark(self, text: str) -> None:
        """A line in the recording's log."""
        self._recorder.mark(Log(time.time_ns(), 0, self._last_us, MARK_PREFIX + text))

    def check_recording(self, emit: Emit) -> None:
        """Say it at once if the recording has ended by itself: nobody strokes for an hour into a full
        disk."""
        writer = self._recorder.writer
        if writer is None:
            return
        try:
            writer.check()
        except RecordingError as error:
            if not self._recorder.give_up(writer):
                return  # somebody has just stopped it, and is told
            writer.close()
            emit(RecordingStopped(f"The recording has stopped: {error}."))

    # ---- the thread

    def run(self, emit: Emit, stop: threading.Event) -> None:
        """Open the probe, tell what it tells, begin again when it is gone; see `Source`."""
        state = LinkState.CONNECTING
        while not stop.is_set():
            try:
                with Probe.open(self._port, recorder=self._recorder) as probe:
                    self._probe = probe
                    state = LinkState.GONE
                    self._follow(probe, emit, stop)
            except LinkError as error:
                text = _GONE if state is LinkState.GONE else f"{_sentence(error)} Trying again every second."
                emit(LinkChanged(state, text))
                if isinstance(error, PortAmbiguous | VersionMismatch):
                    stop.wait(5.0)
            finally:
                self._probe = None
            stop.wait(RETRY_S)

    def _follow(self, probe: Probe, emit: Emit, stop: threading.Event) -> None:
        translator = Translator(CellScale())
        translator.scale.load(probe.read_back(messages.READ_CALIBRATION))
        device = describe(probe, translator.scale)
        self.name = device.serial or self._port
        emit(LinkChanged(LinkState.CONNECTED, "Connected.", device))
        latency = Latency()
        latency.sync(probe)
        probe.start_stream()
        told = 0.0
        while not stop.is_set():
            for event in probe.events(timeout_s=SILENCE_S):
                if isinstance(event, LinkFrame):
                    self._last_us = event.time_us
                    latency.add(event)
                if isinstance(event, Gap):
                    translator.reset()
                    latency.restart()
                    if event.ended:
                        translator.scale.load(probe.read_back(messages.READ_CALIBRATION))
                        emit(
                            LinkChanged(LinkState.CONNECTED, "Connected.", describe(probe, translator.scale))
                        )
                    else:
                        emit(LinkChanged(LinkState.GONE, _GONE))
                    continue
                for shown in translator.feed(event):
                    emit(shown)
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

    def _health(self, probe: Probe, latency_ms: float | None) -> Health:
        frames, counts = probe.frame_counts, probe.counts
        now = time.monotonic()
        self._rate.append((now, frames.received))
        (then, before), span = self._rate[0], now - self._rate[0][0]
        return Health(
            frames_per_s=(frames.received - before) / span if span > 0.2 and then < now else 0.0,
            received=frames.received,
            lost=frames.lost,
            crc_errors=counts.bad_crc,
            resent=counts.resent,
            duplicates=frames.duplicate,
            dropped_by_probe=0,
            latency_ms=latency_ms,
        )


def describe(probe: Probe, scale: CellScale) -> Device:
    """Who answers, for the page's head."""
    identity = probe.identity
    return Device(
        name="Probe" if probe.live else Path(probe.name).name,
        serial=readable(identity.serial),
        firmware=identity.firmware,
        runtime=probe.name if probe.live else "",
        model_id=identity.model_id if identity.model_status == 0 else "",
        full_scale_kPa=scale.full_scale_kPa,
    )


def readable(serial: str) -> str:
    """A serial number as its letters where its bytes are letters, else in hexadecimal."""
    try:
        text = bytes.fromhex(serial).rstrip(b"\0").decode("ascii")
    except ValueError:
        return serial
    return text if text.isprintable() and text.strip() else serial


def _sentence(error: Exception) -> str:
    text = str(error).rstrip(".")
    return f"{text[:1].upper()}{text[1:]}."
