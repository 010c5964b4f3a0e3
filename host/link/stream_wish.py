"""What a client wants streamed, so that it can be asked for again after an unplug or a long silence."""

from __future__ import annotations

from dataclasses import dataclass

LEASE_MS = 30_000
"""How long the probe goes on streaming for a client that says nothing; ours says something each RENEW_S."""
RENEW_S = 3.0


@dataclass
class StreamWish:
    """A stream that is wanted.

    Parameters
    ----------
    content, every, strokes : int
        As `stream_start` takes them; strokes: of all that are still wanted, 0 without end.
    number : int
        The probe's number of the stream that runs for it.
    renewed : float
        When its lease was last renewed, monotonic s.
    """

    content: int
    every: int
    strokes: int
    number: int = 0
    renewed: float = 0.0

    @property
    def words(self) -> tuple[int, int, int, int]:
        """The fields of `stream_start`."""
        return self.content, self.every, self.strokes, LEASE_MS


@dataclass(frozen=True)
class StreamStart:
    """Where a stream begins: its number, its first frame's and its first stroke's."""

    number: int
    next_seq: int
    next_stroke: int
