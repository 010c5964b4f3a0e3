"""A session with a probe, recorded with everything that a replay needs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path

from firmware_py import messages
from palpate.errors import CommandRefused, LinkError
from palpate.link.probe import Probe
from palpate.recording.channels import CALIBRATION, MODEL
from palpate.recording.writer import RecordingWriter


@contextmanager
def recorded(
    port: str, path: str | Path | None, overwrite: bool = False, baud: int = 921_600
) -> Iterator[Probe]:
    """Open a probe and record the session; without a path just open it.

    The recording gets the probe's identity, its model image and calibration (read back, for the replay), the
    clock, and in the end both ends' counts. It is closed whole however the block ends.

    Parameters
    ----------
    port : str
        As `Probe.open` takes it.
    path : str or Path, optional
        The recording, ending in .mcap.
    overwrite : bool
        Replace an existing one.
    baud : int
        Of a UART.

    Raises
    ------
    LinkError, RecordingError
        As `Probe.open` and `RecordingWriter` raise them.
    """
    if path is None:
        with Probe.open(port, baud) as probe:
            probe.begin_counting()
            yield probe
        return
    writer = RecordingWriter(path, overwrite, {"port": port, "palpate": version("palpate")})
    try:
        probe = Probe.open(port, baud, writer)
    except BaseException:
        writer.discard()
        raise
    try:
        with probe:
            probe.begin_counting()
            _introduce(probe, writer)
            try:
                yield probe
            finally:
                _compare_clocks(probe, writer)
                writer.note("counts", {name: str(value) for name, value in both_counts(probe).items()})
    finally:
        writer.close()
    writer.check()


def both_counts(probe: Probe) -> dict[str, int]:
    """What both ends of the link counted in this session, as host_..., frames_... and probe_...

    The latter only if the probe still answers.
    """
    counts = {f"frames_{name}": value for name, value in probe.frame_counts.as_dict().items()}
    counts |= {f"host_{name}": value for name, value in probe.counts.as_dict().items()}
    if probe.connected:
        with suppress(LinkError):  # gone at the very end: its counts are not to be had
            counts |= {f"probe_{name}": value for name, value in probe.session_statistics().items()}
    return counts


def counts_line(counts: dict[str, int]) -> str:
    """What the link lost, in a sentence, from the counts of both ends."""
    damaged = counts["host_bad_crc"] + counts["host_bad_frame"] + counts["host_oversize"]
    text = f"{counts['frames_received']} frames, {counts['frames_lost']} lost, {damaged} damaged packets"
    if counts.get("probe_frames_dropped"):
        text += (
            f", {counts['probe_frames_dropped']} dropped by the probe (the link is slower than the sensors)"
        )
    if counts["host_queue_dropped"]:
        text += f", {counts['host_queue_dropped']} not shown in time"
    if counts["host_reconnects"]:
        text += f", {counts['host_reconnects']} reconnects"
    return text


def _introduce(probe: Probe, writer: RecordingWriter) -> None:
    """Who is recorded, and what it computes with."""
    writer.note("probe", {name: str(value) for name, value in probe.identity.as_dict().items()})
    for name, what in ((MODEL, messages.READ_MODEL), (CALIBRATION, messages.READ_CALIBRATION)):
        try:
            data = probe.read_back(what)
        except CommandRefused:
            data = b""  # a probe that only streams
        if data:
            writer.attach(name, "application/octet-stream", data)
    probe.reference()  # its answer goes into the recording: a replay needs what joins the strokes
    _compare_clocks(probe, writer)


def _compare_clocks(probe: Probe, writer: RecordingWriter) -> None:
    """At both ends of a session: the drift needs the time between."""
    if not probe.connected:
        return
    try:
        clock = probe.sync_clock()
    except LinkError:
        return  # gone at this moment: the comparison at the beginning stays
    words = {
        "offset_us": clock.offset_us,
        "drift_ppm": clock.drift_ppm,
        "uncertainty_us": clock.uncertainty_us,
    }
    writer.note("clock", {name: f"{value:.3f}" for name, value in words.items()})
