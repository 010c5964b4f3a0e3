"""The page's commands, all of them, and `flash`: none reaches the probe's settings, calibration or files.

A command is a JSON object with `do` and its arguments. The answer is `{"ok": true, ...}`, or `{"ok":
false}` with one sentence in `text`.
"""

from __future__ import annotations

import contextlib
import math
import re
import threading
import time
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from palpate.errors import PalpateError, RecordingError, UsageError
from palpate.stroke.lanes import mark_of
from palpate.stroke.stroke import FollowedStroke
from palpate.view.notices import sentence
from palpate.view.session import Session
from palpate.view.source import Flashable, Playable, Recordable, Referable, Source

LoadStrokes = Callable[[Path], Sequence[FollowedStroke]]
SPEEDS = (0.1, 100.0)


class CommandError(UsageError):
    """The page asked for something that cannot be done; the text is for the user."""


class PageCommands:
    """The page's commands, on one session and its source.

    Parameters
    ----------
    recordings : Path
        The one folder that recordings are written to and visits are loaded from.
    load_strokes : callable
        Reads the strokes of a recording.
    """

    def __init__(self, session: Session, source: Source, recordings: Path, load_strokes: LoadStrokes) -> None:
        self._session = session
        self._source = source
        self._recordings = recordings
        self._load_strokes = load_strokes
        self._turning = threading.Lock()  # pages have threads of their own; one recording runs at a time
        self._pressing = threading.Lock()
        self._closed = False
        session.on_lane = self._note_lane
        self.table: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
            "record": self._record,
            "stop-recording": self._stop_recording,
            "mark": self._mark,
            "new-visit": self._new_visit,
            "lanes": self._lanes,
            "recordings": lambda message: {"files": self._files()},
            "load-visit": self._load_visit,
            "repeatability": self._repeatability,
            "compare": self._compare,
            "reference": self._reference,
            "forget-reference": self._forget_reference,
            "play": lambda message: {"commands_applied": self._playable().play()},
            "pause": lambda message: {"commands_applied": self._playable().pause()},
            "seek": self._seek,
            "speed": self._speed,
        }

    def run(self, message: object) -> dict[str, Any]:
        """Do what the page asks; never raises for anything that a page can send."""
        answer: dict[str, Any] = {"type": "answer"}
        if isinstance(message, dict) and isinstance(message.get("id"), int | str):
            answer["id"] = message["id"]
        try:
            if not isinstance(message, dict) or not isinstance(do := message.get("do"), str):
                raise CommandError("A command is an object with the field `do`.")
            if do not in self.table:
                raise CommandError(f"The viewer has no command {do[:40]!r}.")
            return {**answer, "ok": True, **self.table[do](message)}
        except CommandError as error:
            return {**answer, "ok": False, "text": str(error)}
        except PalpateError as error:
            return {**answer, "ok": False, "text": sentence(error)}
        except OSError as error:
            return {**answer, "ok": False, "text": f"That failed: {error.strerror or error}."}

    # ---- recording

    def _record(self, message: dict[str, Any]) -> dict[str, Any]:
        source = self._recordable()
        stem = re.sub(r"[^A-Za-z0-9_-]+", "-", _text(message, "name", "visit")).strip("-")[:60] or "visit"
        with self._turning:
            if self._closed:
                raise CommandError("The viewer is being closed.")
            if self._session.recording is not None:
                raise CommandError("A recording is already running.")
            path = self._new_file(stem)
            source.start_recording(path)
            self._session.set_recording({"file": path.name, "since": time.time()})
            if not source.recording:  # the disk was full at once, and that was reported before the line above
                self._session.set_recording(None)
        return {"file": path.name}

    def _new_file(self, stem: str) -> Path:
        self._recordings.mkdir(parents=True, exist_ok=True)
        path = self._recordings / f"{stem}-{datetime.now():%Y%m%d-%H%M%S}.mcap"
        for n in range(2, 1000):
            if not path.exists():
                break
            path = path.with_name(f"{path.stem.rsplit('+', 1)[0]}+{n}.mcap")
        return path

    def _stop_recording(self, message: dict[str, Any]) -> dict[str, Any]:
        source = self._recordable()
        with self._turning:
            if (running := self._session.recording) is None:
                raise CommandError("No recording is running.")
            try:
                source.stop_recording()
            finally:
                self._session.set_recording(None)
        return {"file": running["file"]}

    def _mark(self, message: dict[str, Any]) -> dict[str, Any]:
        source = self._recordable()
        with self._turning:
            if self._session.recording is None:
                raise CommandError("No recording is running, so the mark has no place.")
            source.mark(_text(message, "text", "mark")[:200])
        return {}

    def _lanes(self, message: dict[str, Any]) -> dict[str, Any]:
        self._recordable()
        told = message.get("told", True)
        if not isinstance(told, bool):
            raise CommandError("`told` must be true or false.")
        with self._session.lock:
            known = self._session.visits.lanes
            next_mm = _number(message, "next_mm", known.next_mm)
            step_mm = _number(message, "step_mm", known.step_mm)
            return {"lanes": self._session.set_lanes(told, next_mm, step_mm)}

    def _note_lane(self, lane_mm: float, started_s: float) -> None:
        """A stroke's lane goes into the recording, if one runs."""
        if isinstance(self._source, Recordable):
            self._source.mark(mark_of(lane_mm, started_s))

    def close(self) -> None:
        """End a running recording properly, and begin no other."""
        with self._turning:
            self._closed = True
            if self._session.recording is None or not isinstance(self._source, Recordable):
                return
            with contextlib.suppress(OSError, RecordingError):
                self._source.stop_recording()
            self._session.set_recording(None)

    def _recordable(self) -> Recordable:
        if not isinstance(self._source, Recordable):
            raise CommandError("A replayed file cannot be recorded again; it is already a recording.")
        return self._source

    # ---- the model

    def flash(self, image: bytes) -> dict[str, Any]:
        """Put a model image onto the probe; the answer as `run` gives it."""
        try:
            if not isinstance(self._source, Flashable):
                raise CommandError("A recording takes no model; the probe that it came from does.")
            with self._turning:
                if self._session.recording is not None:
                    raise CommandError(
                        "Stop the recording first: its strokes belong to the model it began with."
                    )
                return {"ok": True, "model_id": self._source.flash(image)}
        except PalpateError as error:
            return {"ok": False, "text": sentence(error)}

    # ---- the reference press

    def _reference(self, message: dict[str, Any]) -> dict[str, Any]:
        source = self._referable()
        if not self._pressing.acquire(blocking=False):
            raise CommandError("The probe waits for a reference press already.")
        try:
            return {"text": source.take_reference()}
        finally:
            self._pressing.release()

    def _forget_reference(self, message: dict[str, Any]) -> dict[str, Any]:
        self._referable().forget_reference()
        return {}

    def _referable(self) -> Referable:
        if not isinstance(self._source, Referable):
            raise CommandError("A recording has no probe to press.")
        return self._source

    # ---- visits

    def _new_visit(self, message: dict[str, Any]) -> dict[str, Any]:
        with self._session.lock:
            visits = self._session.visits
            name = _text(message, "name", f"Visit {len(visits.snapshot()['visits']) + 1}")[:80]
            number = visits.start(name).number
            self._session.tell_visits()
        return {"visit": number}

    def _load_visit(self, message: dict[str, Any]) -> dict[str, Any]:
        name = _text(message, "file", "")
        if name not in self._files():
            raise CommandError(f"There is no recording {name[:80]!r} in the recordings folder.")
        strokes = self._load_strokes(self._recordings / name)
        if not strokes:
            raise CommandError(f"{name} holds no stroke.")
        with self._session.lock:
            number = self._session.visits.add_earlier(Path(name).stem, strokes).number
            self._session.tell_visits()
        return {"visit": number, "strokes": len(strokes)}

    def _files(self) -> list[str]:
        if not self._recordings.is_dir():
            return []
        return sorted(p.name for p in self._recordings.glob("*.mcap") if p.is_file() and not p.is_symlink())

    def _repeatability(self, message: dict[str, Any]) -> dict[str, Any]:
        with self._session.lock:
            return self._session.visits.repeatability(
                self._visit(message, "visit"), int(_number(message, "last", 5))
            )

    def _compare(self, message: dict[str, Any]) -> dict[str, Any]:
        with self._session.lock:
            return self._session.visits.compare(self._visit(message, "a"), self._visit(message, "b"))

    def _visit(self, message: dict[str, Any], key: str) -> int:
        number = int(_number(message, key, 1))
        if not self._session.visits.has(number):
            raise CommandError(f"There is no visit {number}.")
        return number

    # ---- replay

    def _seek(self, message: dict[str, Any]) -> dict[str, Any]:
        return {"commands_applied": self._playable().seek(max(0.0, _number(message, "position_s", 0.0)))}

    def _speed(self, message: dict[str, Any]) -> dict[str, Any]:
        speed = min(max(_number(message, "speed", 1.0), SPEEDS[0]), SPEEDS[1])
        return {"commands_applied": self._playable().set_speed(speed)}

    def _playable(self) -> Playable:
        if not isinstance(self._source, Playable):
            raise CommandError("A live probe cannot be paused or wound back; record it and open the file.")
        return self._source


def _text(message: dict[str, Any], key: str, default: str) -> str:
    value = message.get(key, default)
    if not isinstance(value, str):
        raise CommandError(f"`{key}` must be text.")
    return value.strip() or default


def _number(message: dict[str, Any], key: str, default: float) -> float:
    value = message.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise CommandError(f"`{key}` must be a number.")
    return float(min(max(value, -1e9), 1e9))
