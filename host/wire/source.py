"""Where events come from: a probe at the end of a line, or a recording of one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import ClassVar, Self

from palpate.wire.accounting import LinkCounts, StreamCounts
from palpate.wire.events import Event
from palpate.wire.identity import Identity
from palpate.wire.parser import LiveParser
from palpate.wire.scale import CellScale


class EventSource(ABC):
    """What a live probe and a recording have in common; use as a context manager.

    Parameters
    ----------
    name : str
        The port's or the recording's name.
    parser : LiveParser
        Turns the wire's bytes into events, and counts them.
    """

    live: ClassVar[bool]
    """False for a recording."""

    def __init__(self, name: str, parser: LiveParser) -> None:
        self.name = name
        self._parser = parser

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    @abstractmethod
    def identity(self) -> Identity:
        """Who answered the last handshake."""

    @property
    def counts(self) -> LinkCounts:
        """What the host's end of the link counted."""
        return self._parser.counts

    @property
    def frame_counts(self) -> StreamCounts:
        """Frames received, lost, duplicate, late."""
        return self._parser.frames.counts

    @property
    def scale(self) -> CellScale:
        """What frames are decoded with: the probe's calibration, or the nominal one (not `calibrated`)."""
        return self._parser.scale

    @property
    def kept_reference(self) -> tuple[int, int, int] | None:
        """The reference press that joins the strokes now, as far as this wire told: `Stage.set` takes it."""
        return self._parser.reference

    @abstractmethod
    def events(self, timeout_s: float | None = None) -> Iterator[Event]:
        """Events as they come, until `timeout_s` passes without one, or a recording ends."""

    @abstractmethod
    def close(self) -> None:
        """Release the port; harmless when repeated."""
