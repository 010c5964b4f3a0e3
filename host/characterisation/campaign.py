"""The campaign: a TOML file that says what each recording is of.

[[recording]]
file = "air-1.mcap"
kind = "air"                     # nothing touches the cells
displacement_mm = 0.0            # optional: where the probe was held

[[recording]]
file = "cuff-1.mcap"
kind = "cuff"                    # the same known pressure on all cells
kPa = [[0, 0], [0.5, 0], [0.5, 18], [2, 18], [4, 0]]    # time in s, pressure in kPa

[[recording]]
file = "plain-1.mcap"
kind = "plain"                   # strokes over plain tissue
travel_mm = 80.0                 # optional: how far they really went
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import RecordingError, UsageError
from palpate.files import read_toml
from palpate.recording.playback import open_recording
from palpate.wire.cells import SHAPE
from palpate.wire.events import Estimate, Frame

Floats = NDArray[np.float64]

KINDS = ("air", "cuff", "plain")
EARLIEST_S, STEP_S = 5.0, 0.02
"""How far from the first frame a cuff's course may begin, and how finely that is looked for at first."""
FEWEST = 16
"""Frames of a recording, or of a stroke, that says anything."""


@dataclass(frozen=True)
class Course:
    """A cuff's pressure in time.

    Attributes
    ----------
    time_s, kPa : (k,)
        Straight between these points.
    begins_s : float
        When it began, from the first frame: nobody pumps on the frame, so it is found in what the cells read.
    """

    time_s: Floats
    kPa: Floats
    begins_s: float = 0.0

    def at(self, time_s: Floats) -> Floats:
        """The pressure at times from the first frame, (n,)."""
        return np.interp(time_s - self.begins_s, self.time_s, self.kPa)

    def beginning(self, begins_s: float) -> Course:
        """The same course, begun then."""
        return replace(self, begins_s=begins_s)


@dataclass(frozen=True)
class Measured:
    """One recording of a campaign.

    Attributes
    ----------
    file : Path
    kind : str
    counts : (n, rows, columns)
        Raw.
    kPa : (n, rows, columns)
        By the probe's calibration.
    position_mm, displacement_mm, time_s : (n,)
    strokes : list of slices
        The frames of each stroke.
    course : Course or None
        The cuff's.
    known_displacement_mm, travel_mm : float
        NaN where it is not said.
    """

    file: Path
    kind: str
    counts: Floats
    kPa: Floats
    position_mm: Floats
    displacement_mm: Floats
    time_s: Floats
    strokes: list[slice]
    course: Course | None
    known_displacement_mm: float
    travel_mm: float


def read(path: str | Path) -> list[Measured]:
    """Read a campaign and its recordings.

    Raises
    ------
    NoSuchFile, UsageError, RecordingError
        The sentence names the recording by its number.
    """
    path = Path(path)
    said = read_toml(path, "campaign")
    entries = said.get("recording")
    if set(said) - {"recording"} or not isinstance(entries, list) or not entries:
        raise UsageError(f"{path} is a list of [[recording]], each with file and kind, and nothing else")
    found = [_measured(path, k + 1, entry) for k, entry in enumerate(entries)]
    for k, one in enumerate(found):
        if any(one.file.samefile(other.file) for other in found[:k]):
            raise UsageError(f"{path}, recording {k + 1}: {one.file.name} is there already")
    return found


def _measured(path: Path, number: int, entry: dict[str, Any]) -> Measured:
    where = f"{path}, recording {number}"
    kind = entry.get("kind")
    if kind not in KINDS:
        raise UsageError(f"{where}: kind is one of {', '.join(KINDS)}, not {kind!r}")
    allowed = {
        "file",
        "kind",
        *{"air": ("displacement_mm",), "cuff": ("kPa",), "plain": ("travel_mm",)}[kind],
    }
    if extra := sorted(set(entry) - allowed):
        raise UsageError(f"{where}: {kind} knows no {extra[0]!r}; it knows {', '.join(sorted(allowed))}")
    if not isinstance(entry.get("file"), str):
        raise UsageError(f"{where} names no file")
    course = _course(entry.get("kPa"), where) if kind == "cuff" else None
    known = [_known(entry, name, where) for name in ("displacement_mm", "travel_mm")]
    file = path.parent / entry["file"]
    counts, kPa, places, strokes = _frames(file)
    if len(counts) < FEWEST:
        raise RecordingError(f"{where}: {file.name} holds {len(counts)} frames; {FEWEST} say something")
    if course is not None:
        course = _begun(course, kPa, places[:, 2])
    if kind == "plain" and not strokes:
        raise RecordingError(f"{where}: {file.name} holds no stroke")
    return Measured(
        file,
        kind,
        counts,
        kPa,
        places[:, 0],
        places[:, 1],
        places[:, 2],
        strokes,
        course,
        *known,
    )


def _known(entry: dict[str, Any], name: str, where: str) -> float:
    value = entry.get(name, math.nan)
    if name in entry and not _is_number(value):
        raise UsageError(f"{where}: {name} is a number, not {value!r}")
    return float(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _course(value: Any, where: str) -> Course:
    """A step is two points at one time, which lie a microsecond apart here."""
    good = isinstance(value, list) and all(
        isinstance(p, list) and len(p) == 2 and all(map(_is_number, p)) and p[1] >= 0 for p in value
    )
    if not good or not value or any(b[0] < a[0] for a, b in itertools.pairwise(value)):
        raise UsageError(f"{where}: kPa is a list of [time in s, kPa] in the order of time, none below 0")
    table = np.array(value, float)
    if not np.ptp(table[:, 1]):
        raise UsageError(f"{where}: the cuff's pressure does not change, which cannot tell gains from zeros")
    return Course(table[:, 0] + 1e-6 * np.arange(len(table)), table[:, 1])


def _begun(course: Course, kPa: Floats, time_s: Floats) -> Course:
    """The course begun where the middle cell's readings follow it best, to `STEP_S`."""
    seen = np.median(kPa.reshape(len(kPa), -1), axis=1)
    seen -= seen.mean()

    def likeness(begins_s: float) -> float:
        p = course.beginning(begins_s).at(time_s)
        p -= p.mean()
        size = float(np.sqrt((p**2).sum()))
        return float(p @ seen) / size if size > 1e-9 else 0.0

    steps = np.arange(-EARLIEST_S, EARLIEST_S + STEP_S / 2, STEP_S)
    steps = steps[np.argsort(np.abs(steps), kind="stable")]  # of equals the one nearest to the first frame
    return course.beginning(float(steps[np.argmax([likeness(step) for step in steps])]))


def _frames(file: Path) -> tuple[Floats, Floats, Floats, list[slice]]:
    frames: list[Frame] = []
    at: dict[int, int] = {}
    strokes = []
    with open_recording(file) as session:
        session.recording.calibration()  # that it can be read
        for event in session.events():
            if isinstance(event, Frame):
                at[event.seq] = len(frames)
                frames.append(event)
            elif isinstance(event, Estimate) and event.first_seq in at and event.frames >= FEWEST:
                first = at[event.first_seq]
                strokes.append(slice(first, first + event.frames))
    counts = np.array([f.counts for f in frames], float).reshape(-1, *SHAPE)
    kPa = np.array([f.pressure_kPa for f in frames], float).reshape(-1, *SHAPE)
    begin = frames[0].time_us if frames else 0
    rows = [[f.position_um / 1e3, f.displacement_um / 1e3, (f.time_us - begin) / 1e6] for f in frames]
    return counts, kPa, np.array(rows, float).reshape(-1, 3), strokes
