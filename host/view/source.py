"""Where the viewer's events come from: a live probe and a recording look the same from here.

What a page can change on a probe is its model, and only to one that the probe itself accepts: signed by a key
that it trusts, and never an older one; and the visit's reference press. No source offers a way to settings or
calibration.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, runtime_checkable

from palpate.stroke.stroke import FollowedStroke
from palpate.view.notices import Notice
from palpate.wire.events import Event

Emit = Callable[[Event | Notice | FollowedStroke], None]
"""Takes an event (answers as `stroke.answered` tells them), a notice, or a stroke that was read ahead."""


class Source(Protocol):
    """A source of events."""

    name: str

    def run(self, emit: Emit, stop: threading.Event) -> None:
        """Emit events until `stop` is set; runs in a thread of its own and recovers by itself from a gap."""


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
class Flashable(Protocol):
    """A source that can be given another model."""

    def flash(self, image: bytes) -> str:
        """Put a signed model image onto the probe; the id of the model that is live then."""


@runtime_checkable
class Referable(Protocol):
    """A source whose probe can be pressed beside the lump, for what that says of the tissue."""

    def take_reference(self) -> str:
        """Wait for the press, in a pause of the stream; what it says, in words."""

    def forget_reference(self) -> None:
        """The strokes to come go without it."""


@runtime_checkable
class Playable(Protocol):
    """A source with a beginning and an end.

    Each command returns how many have been applied, itself included: what the next `Playback` counts.
    """

    def play(self) -> int:
        """Go on from where it stands (from the beginning, at the end)."""

    def pause(self) -> int:
        """Stand still."""

    def seek(self, position_s: float) -> int:
        """Go to that many seconds after the beginning."""

    def set_speed(self, speed: float) -> int:
        """Set the speed, as a multiple of real time."""
