"""A recording as a source: one thread reads ahead, another plays it at the speed asked for.

Frames stay packed until they are shown. A file with more than `MAX_FRAMES` is kept thinned (every second,
every fourth ... frame): enough for the eye; strokes are put together from all of its frames.
"""

from __future__ import annotations

import threading
import time
from bisect import bisect_right
from collections.abc import Sequence
from pathlib import Path

from palpate.model_export.schema import ModelSpec
from palpate.recording.playback import RecordedSession, open_recording
from palpate.recording.reader import Recording
from palpate.stroke.answered import AnsweredEvents
from palpate.stroke.follower import Follower
from palpate.stroke.lanes import lane_of
from palpate.stroke.read import follower_of, strokes_of
from palpate.view.live import describe
from palpate.view.notices import Health, Jumped, LinkChanged, LinkState, Mark, OtherEnd, Playback
from palpate.view.source import Emit
from palpate.wire.events import Event, Frame, Gap, Log

MAX_FRAMES = 200_000
TICK_S = 0.01
FRAMES_A_TICK = 3
PLAYBACK_EVERY_S = 0.1


class ReplaySource:
    """A recording with play, pause, seek and speed.

    Parameters
    ----------
    path : Path
    document : ModelSpec, optional
        Of the recorded model, where it is none that comes with Palpate.

    Raises
    ------
    PalpateError
        The file is not there or not a recording.
    """

    def __init__(self, path: Path, document: ModelSpec | None = None) -> None:
        Recording(path)  # a file that is none is refused here, before there is a page
        self.path = path
        self._document = document
        self.name = path.name
        self._lock = threading.Lock()
        self._times: list[float] = []
        self._events: list[Event] = []
        self._frames = 0
        self._stride = 1
        self._loaded = False
        self._strokes_s: list[float] = []
        self._marks: list[Mark] = []
        self._position_s = 0.0
        self._speed = 1.0
        self._playing = True
        self._moved = False
        self._commands_applied = 0

    # ---- controls

    def play(self) -> int:
        """Go on (from the beginning, at the end)."""
        with self._lock:
            if self._loaded and self._position_s >= self._length():
                self._position_s, self._moved = 0.0, True
            self._playing = True
            return self._applied()

    def pause(self) -> int:
        """Stand still."""
        with self._lock:
            self._playing = False
            return self._applied()

    def seek(self, position_s: float) -> int:
        """Go to so many seconds after the beginning (as far as the file has been read)."""
        with self._lock:
            self._position_s = min(max(position_s, 0.0), self._length())
            self._moved = True
            return self._applied()

    def set_speed(self, speed: float) -> int:
        """The speed, as a multiple of real time."""
        with self._lock:
            self._speed = speed
            return self._applied()

    def _applied(self) -> int:
        self._commands_applied += 1
        return self._commands_applied

    # ---- the threads

    def run(self, emit: Emit, stop: threading.Event) -> None:
        """Play the recording; see `Source`. Returns only when stopped: a recording can be wound back."""
        with open_recording(self.path) as session:
            follower = follower_of(session.recording, self._document)
            device = describe(session, follower.documents)
            emit(LinkChanged(LinkState.CONNECTED, "", device))
            loader = threading.Thread(target=self._load, args=(session, follower, emit, stop), daemon=True)
            loader.start()
            self._play(device, emit, stop)
            loader.join()

    def _load(self, session: RecordedSession, follower: Follower, emit: Emit, stop: threading.Event) -> None:
        first_ns: int | None = None
        at_s = 0.0

        def seen(event: Event) -> None:
            nonlocal first_ns, at_s
            first_ns = first_ns or event.host_ns
            at_s = (event.host_ns - first_ns) * 1e-9
            self._keep(at_s, event)
            if isinstance(event, Log):
                self._note_mark(at_s, event.mark)

        for stroke in strokes_of(session, follower, seen, stop.is_set):
            with self._lock:
                self._strokes_s.append(at_s)
            emit(stroke)
        if stop.is_set():
            return
        counts = session.counts
        emit(Health(lost=session.frame_counts.lost, crc_errors=counts.bad_crc, resent=counts.resent))
        with self._lock:
            self._loaded = True

    def _keep(self, at_s: float, event: Event) -> None:
        with self._lock:
            if isinstance(event, Frame):
                self._frames += 1
                if self._frames % self._stride:
                    return
            self._times.append(max(at_s, self._times[-1] if self._times else 0.0))
            self._events.append(event)
            if len(self._events) > MAX_FRAMES:
                self._thin()

    def _thin(self) -> None:
        self._stride *= 2
        kept, odd = [], False
        for pair in zip(self._times, self._events, strict=True):
            if isinstance(pair[1], Frame):
                odd = not odd
                if odd:
                    continue
            kept.append(pair)
        self._times, self._events = [t for t, _ in kept], [e for _, e in kept]

    def _note_mark(self, at_s: float, text: str | None) -> None:
        """A mark for the ticks; a stroke's lane is none: the map shows it."""
        if text is not None and lane_of(text) is None:
            with self._lock:
                self._marks.append(Mark(max(at_s, 0.0), text))

    def _play(self, device: OtherEnd, emit: Emit, stop: threading.Event) -> None:
        answers = AnsweredEvents()
        before, told = time.monotonic(), 0.0
        ended = False
        while not stop.wait(TICK_S):
            now = time.monotonic()
            due, moved = self._advance(now - before)
            before = now
            if moved:
                answers.forget()
                emit(Jumped())
            for event in due:
                for each in answers.feed(event):
                    emit(each)
                if isinstance(event, Gap):
                    emit(LinkChanged(*_gap(event), device))
            playback = self._playback()
            at_end = not playback.playing and playback.position_s >= playback.length_s > 0.0
            if at_end != ended:
                ended = at_end
                state = LinkState.ENDED if ended else LinkState.CONNECTED
                emit(LinkChanged(state, "The recording has ended.", device))
            if now - told > PLAYBACK_EVERY_S or moved:
                told = now
                emit(playback)

    def _advance(self, elapsed_s: float) -> tuple[Sequence[Event], bool]:
        """Move along; returns the events passed on the way (of many frames, some) and whether it jumped."""
        with self._lock:
            moved, self._moved = self._moved, False
            end = self._length()
            if moved:
                i = bisect_right(self._times, self._position_s)
                shown = next((e for e in reversed(self._events[:i]) if isinstance(e, Frame)), None)
                return ([shown] if shown is not None else []), True
            if not self._playing:
                return (), False
            begin = self._position_s
            self._position_s = min(begin + elapsed_s * self._speed, end)
            if self._loaded and self._position_s >= end:
                self._playing = False
            first = bisect_right(self._times, begin) if begin > 0.0 else 0
            due = self._events[first : bisect_right(self._times, self._position_s)]
        frames = sum(isinstance(e, Frame) for e in due)
        step = -(-frames // FRAMES_A_TICK) or 1
        thinned, n = [], 0
        for event in due:
            if isinstance(event, Frame):
                n += 1
                if (frames - n) % step:
                    continue
            thinned.append(event)
        return thinned, False

    def _length(self) -> float:
        return self._times[-1] if self._times else 0.0

    def _playback(self) -> Playback:
        with self._lock:
            return Playback(
                position_s=self._position_s,
                length_s=self._length(),
                playing=self._playing,
                speed=self._speed,
                commands_applied=self._commands_applied,
                strokes_s=tuple(self._strokes_s),
                marks=tuple(self._marks),
            )


def _gap(event: Gap) -> tuple[LinkState, str]:
    if event.ended:
        return LinkState.CONNECTED, ""
    return LinkState.GONE, "Here the link to the probe was broken for a while."
