"""How a stroke's results come: again, from an earlier stream, and when all of them are there."""

from __future__ import annotations

import time
from dataclasses import dataclass

from firmware_py import messages
from palpate.wire.frame import Event
from palpate.wire.results import Estimate, Features, TactileMap


@dataclass(slots=True)
class Again(Event):
    """A duplicate result; clients acknowledge it and otherwise ignore it."""

    event: TactileMap | Features | Estimate


@dataclass(slots=True)
class Earlier(Event):
    """A result of a stream that this client did not begin; it is offered apart (`Probe.earlier_results`)."""

    event: TactileMap | Features | Estimate


HAVE = {TactileMap: messages.HAVE_MAP, Features: messages.HAVE_FEATURES, Estimate: messages.HAVE_ESTIMATE}
"""Results of a stroke that the probe sends until they are acknowledged, and their bit in stroke_ack."""


class Awaited:
    """Tells when a client that wants so many strokes has all of them: the maps come behind the estimates.

    Parameters
    ----------
    strokes : int
        How many; 0: never enough.
    times_slower : float
        Seconds of this computer that one of the probe's takes.
    """

    PATIENCE_S = 5.0
    """How long a map or features that do not come are waited for once the estimates are there."""

    def __init__(self, strokes: int, times_slower: float = 1.0) -> None:
        self.begun = False
        self._patience_s = self.PATIENCE_S * times_slower
        self._strokes = strokes
        self._have: dict[tuple[int, int], int] = {}
        self._estimates = 0
        self._since = 0.0

    def enough(self, event: Event) -> bool:
        """Take the next event; True when nothing more is waited for."""
        if not self._strokes:
            return False
        if isinstance(event, TactileMap | Features | Estimate):
            key = event.stream, event.stroke
            self._have[key] = self._have.get(key, 0) | HAVE[type(event)]
            if isinstance(event, Estimate):
                self._estimates += 1
                self._since = time.monotonic()
        if self._estimates < self._strokes:
            return False
        complete = sum(have == messages.HAVE_ALL for have in self._have.values())
        return complete >= self._strokes or time.monotonic() - self._since > self._patience_s
