"""The bounded queue between the thread that reads and the program: frames give way, results never."""

from __future__ import annotations

import threading
from collections import deque

from palpate.wire.events import Event, Frame

FRAMES_KEPT = 2048
"""Frames that may wait: ten seconds at 200 frames/s, 2 MB."""


class EventQueue:
    """Events in order; when too many frames wait, the oldest frame is dropped and counted in `dropped`."""

    def __init__(self, frames_kept: int = FRAMES_KEPT) -> None:
        self.dropped = 0
        self._frames_kept = frames_kept
        self._frames = 0
        self._events: deque[Event] = deque()
        self._ready = threading.Condition()
        self._closed = False

    def put(self, event: Event) -> None:
        """Append an event; never blocks."""
        with self._ready:
            if type(event) is Frame:
                self._frames += 1
                if self._frames > self._frames_kept:
                    self._drop_oldest_frame()
            self._events.append(event)
            self._ready.notify()

    def get(self, timeout_s: float | None) -> Event | None:
        """The next event, or None after `timeout_s` (None: wait) or once closed and empty."""
        with self._ready:
            if not self._ready.wait_for(lambda: self._events or self._closed, timeout_s) or not self._events:
                return None
            event = self._events.popleft()
            if type(event) is Frame:
                self._frames -= 1
            return event

    def close(self) -> None:
        """No more events will come: wake whoever waits."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()

    def _drop_oldest_frame(self) -> None:
        for i, event in enumerate(self._events):
            if type(event) is Frame:
                del self._events[i]
                self._frames -= 1
                self.dropped += 1
                return
