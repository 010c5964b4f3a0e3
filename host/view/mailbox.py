"""What waits to be sent to one page: bounded, and the newest wins.

Frames, the running stroke and the link's health are *slots*: a new one replaces an unsent old one, so a slow
page shows the present and never a growing past. Finished strokes and notices are *events*, kept in order; a
page that falls hundreds of events behind is told everything afresh instead (`overflowed`).
"""

from __future__ import annotations

import threading
from collections import deque
from operator import itemgetter
from typing import Any

Message = dict[str, Any] | bytes
FRAME = "frame"


class Mailbox:
    """Messages for one page; safe to fill from any thread.

    Parameters
    ----------
    max_events : int
        Events kept before the page is given up as too far behind.
    """

    def __init__(self, max_events: int = 256) -> None:
        self._lock = threading.Lock()
        self._slots: dict[str, tuple[int, Message]] = {}
        self._events: deque[tuple[int, Message]] = deque()
        self._max_events = max_events
        self._count = 0
        self.overflowed = False

    def put_slot(self, name: str, message: Message) -> None:
        """Offer the newest message of its kind."""
        with self._lock:
            self._slots[name] = (self._next(), message)

    def put_event(self, message: Message) -> None:
        """Add a message that must not be skipped."""
        with self._lock:
            if len(self._events) >= self._max_events:
                self._events.clear()
                self.overflowed = True
            if not self.overflowed:
                self._events.append((self._next(), message))

    def take(self, *, with_frame: bool = True) -> list[Message]:
        """Everything that waits, in the order it was added (an older state must not overtake a newer); a
        frame last, and only if the page can draw one."""
        with self._lock:
            waiting = [*self._events, *(told for name, told in self._slots.items() if name != FRAME)]
            frame = self._slots.get(FRAME)
            self._events.clear()
            self._slots.clear()
            messages = [message for _, message in sorted(waiting, key=itemgetter(0))]
            if frame is not None and with_frame:
                messages.append(frame[1])
            elif frame is not None:
                self._slots[FRAME] = frame
            return messages

    def reset(self) -> None:
        """Forget everything: the page is about to get the whole state."""
        with self._lock:
            self._slots.clear()
            self._events.clear()
            self.overflowed = False

    def _next(self) -> int:
        self._count += 1
        return self._count

    def __len__(self) -> int:
        with self._lock:
            return len(self._slots) + len(self._events)
