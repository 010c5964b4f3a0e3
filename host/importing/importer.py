"""`import`: files of frames to recordings, one each, and what was missing. Units: kPa, mm, s."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from firmware_py import calib, geometry
from palpate.errors import RecordingError
from palpate.files import whole_file
from palpate.importing import frames as sources
from palpate.importing import ours, places, published, resample
from palpate.importing.declaration import Declaration
from palpate.importing.firmware import ImportedSession
from palpate.importing.frames import GivenFrames, ImportFailed
from palpate.model_export.image_builder import inspect
from palpate.recording import channels
from palpate.recording.channels import IMPORT_NOTE
from palpate.recording.reader import Recording
from palpate.recording.writer import RecordingWriter, check_name
from palpate.wire.cells import FULL_SCALE_KPA, PEDESTAL_KPA
from palpate.wire.events import Estimate
from palpate.wire.packing import pack

PAUSE_US = 300_000
"""Between two strokes."""
WORST_SATURATED = 0.001
"""Share of readings at the end of the scale from which it is worth a remark."""


@dataclass(frozen=True)
class Imported:
    """What became of one file.

    Attributes
    ----------
    source, recording : Path
    strokes : int
        Strokes that the probe's own rules found: numbers 1 to `strokes`.
    frames : int
    missing : tuple of str
        displacement, position, time: what the file did not have.
    remarks : tuple of str
        What else should be known, a sentence each.
    """

    source: Path
    recording: Path
    strokes: int
    frames: int
    missing: tuple[str, ...]
    remarks: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def import_file(
    source: str | Path,
    recording: str | Path,
    said: Declaration | None,
    model: bytes | None = None,
    overwrite: bool = False,
    track: Path | None = None,
) -> Imported:
    """Make a recording of a file of frames.

    Parameters
    ----------
    source : path
        .csv, .parquet, .npz, .h5, .hdf5; or .mcap, a recording of ours by another array.
    recording : path
        Ends in .mcap.
    said : Declaration or None
        What the frames are; a recording of ours says it itself.
    model : bytes, optional
        The image that makes the estimates; without one the recording holds frames, map and features only.
    overwrite : bool
        Replace an existing recording.
    track : Path, optional
        A table of places for a recording of ours, see `places.join`.

    Raises
    ------
    ImportFailed, NoSuchFile, UnknownFormat, MissingExtra, RecordingError
    """
    source, recording = Path(source), Path(recording)
    port, calibrated, joined = "import", True, list[str]()
    if source.suffix.lower() == ".mcap":
        found, said = ours.read(source, said, whole=track is not None)
        if track is not None:
            found, joined = places.join(found, ours.began_s(source), track)
            of = Recording(source)  # which stays what it was: somebody's array, calibrated or not
            port = of.metadata().get("session", {}).get("port", port)
            calibrated = of.attachment(channels.CALIBRATION) is not None
    elif track is not None:
        raise ImportFailed(f"--position goes with recordings (.mcap); {source.name} has its own places")
    elif said is None:
        raise ImportFailed(
            f"{source.name} does not say what it holds; write a declaration and give it with --as "
            "(`palpate import --help` shows one)" + _names_in(source)
        )
    else:
        found = sources.read(source, said)
    remarks = [*_about(found, said), *joined]
    counts = _counts(found, said, remarks)
    info = None if model is None else inspect(model)
    words = {
        "source": source.name,
        "sha256": _sha256(source),
        "array": f"{said.rows}x{said.columns} at {said.pitch_mm[0]:g} x {said.pitch_mm[1]:g} mm",
        "missing": " ".join(found.missing),
    }
    began_ns = source.stat().st_mtime_ns
    meta = {"port": port, "started_ns": str(began_ns)}
    check_name(recording)
    if recording.exists() and not overwrite:
        raise RecordingError(f"{recording} exists already; choose another name or give --overwrite")
    with whole_file(recording) as part:
        with RecordingWriter(part, True, meta) as writer:
            writer.note(IMPORT_NOTE, words)
            writer.note("probe", {"serial": "IMPORTED", "array": words["array"]})
            if calibrated:
                nominal = calib.Calibration().to_bytes()
                writer.attach(channels.CALIBRATION, "application/octet-stream", nominal)
            if model is not None:
                writer.attach(channels.MODEL, "application/octet-stream", model)
            strokes = _play(ImportedSession(writer, info, began_ns), found, counts, said.lift)
        writer.check()
    declared = len(np.unique(found.stroke))
    if not strokes and len(found.position_mm) and np.ptp(found.position_mm) == 0:
        remarks.append(f"{declared} presses and no stroke: `palpate refine` is for these")
    elif said.stroke and strokes != declared:
        remarks.append(
            f"{declared} strokes are declared, {strokes} were found: too short, or not in contact?"
        )
    elif not strokes and said.lift:
        remarks.append(
            "no stroke was found: the probe never pressed and moved on by .5 mm; look at the units"
        )
    return Imported(source, recording, strokes, len(counts), found.missing, tuple(remarks))


def _names_in(source: Path) -> str:
    """The names of a published layout's arrays, for who declares them."""
    if source.suffix.lower() == ".mat":
        return f"; it has {published.OF_PRESSES}"
    if source.suffix.lower() in (".h5", ".hdf5"):
        return f"; in LESS' layout it has {published.OF_LESS}"
    return ""


def _sha256(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _counts(found: GivenFrames, said: Declaration, remarks: list[str]) -> np.ndarray:
    pressure = found.pressure_kPa
    if not resample.suits(said.rows, said.columns, said.pitch_mm):
        pressure = resample.onto_this_array(pressure, said.pitch_mm)
    counts = np.rint((pressure + PEDESTAL_KPA) / FULL_SCALE_KPA * geometry.FULL_COUNT)
    high = float((counts > geometry.FULL_COUNT).mean())
    if high > WORST_SATURATED:
        most = FULL_SCALE_KPA - PEDESTAL_KPA
        remarks.append(
            f"{100 * high:.1f} % of the readings are over {most:g} kPa, where this array's scale ends "
            "(palpate --array has another)"
        )
    return np.clip(counts, 0, geometry.FULL_COUNT).astype(np.uint16).reshape(len(counts), -1)


def _about(found: GivenFrames, said: Declaration) -> list[str]:
    out = []
    if "displacement" in found.missing:
        out.append("no displacement: features of the pressure only can be used")
    if "position" in found.missing:
        out.append(f"no position: taken as a steady {said.constant_mm_per_s:g} mm/s")
    if "time" in found.missing:
        out.append(f"no time: taken as {said.frames_per_s:g} frames a second")
    if not resample.suits(said.rows, said.columns, said.pitch_mm):
        array = f"{said.rows} x {said.columns} cells at {said.pitch_mm[0]:g} mm"
        text = f"{array} were resampled to {geometry.NAME.decode()}"
        along, across = resample.uncovered_mm(said.rows, said.columns, said.pitch_mm)
        if along > said.pitch_mm[0] / 2:
            text += f"; {along:g} mm of the length is not covered"
        if across > said.pitch_mm[1]:
            text += f"; {across:g} mm of the width goes on as at the edge"
        out.append(text)
    return out


def _play(session: ImportedSession, found: GivenFrames, counts: np.ndarray, lift: bool) -> int:
    """All strokes through the firmware, with `lift` in the air between; how many estimates came."""
    clock, estimates = 0, 0
    for number in np.unique(found.stroke):
        own = np.flatnonzero(found.stroke == number)
        times = clock + 10_000 + np.rint(1e6 * (found.time_s[own] - found.time_s[own[0]])).astype(np.int64)
        positions = np.rint(1e3 * found.position_mm[own]).astype(np.int64)
        depths = np.rint(1e3 * found.displacement_mm[own]).astype(np.int64)
        if lift:
            session.lifted(clock, int(positions[0]))
        said = []
        for k, row in enumerate(own):
            said += session.frame(pack(counts[row]), int(positions[k]), int(depths[k]), int(times[k]))
        if lift:
            said += session.lifted(int(times[-1]) + 10_000, int(positions[-1]))
        estimates += sum(isinstance(event, Estimate) for event in said)
        clock = int(times[-1]) + PAUSE_US
    session.end()
    return estimates
