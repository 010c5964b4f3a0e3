"""Where the viewer's events come from: a live probe and a recording look the same from here.

No source offers a way to the probe's flash commands: the page cannot reach them, with or without a token.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, runtime_checkable

from host.view.events import Event
from host.view.stroke import Stroke

Emit = Callable[[Event | Stroke], None]
"""Takes an event, or a whole stroke that the source has read ahead of what it tells."""


class Source(Protocol):
    """Something that tells events."""

    name: str

    def run(self, emit: Emit, stop: threading.Event) -> None:
        """Tell events until `stop` is set; runs in a thread of its own and comes back by itself after a
        gap."""


@runtime_checkable
class Recordable(Protocol):
    """A source whose stream can be written to a file."""

    @property
    def recording(self) -> bool:
        """Is a file being written? False after a recording that ended by itself (a full disk)."""

    def start_recording(self, path: Path) -> None:
        """Write everything that comes from now on to `path` (which must not exist)."""

    def stop_recording(self) -> None:
        """Close the file."""

    def mark(self, text: str) -> None:
        """Put a note into the recording at this moment."""


@runtime_checkable
class Playable(Protocol):
    """A source with a beginning and an end. Each control returns how many it has obeyed, itself included,
    as the `Playback` does that comes of it."""

    def play(self) -> int:
        """Go on from where it stands (from the beginning, at the end)."""

    def pause(self) -> int:
        """Stand still."""

    def seek(self, position_s: float) -> int:
        """Go to that many seconds after the beginning."""

    def set_speed(self, speed: float) -> int:
        """Run so many times as fast as life."""
