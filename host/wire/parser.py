"""The live parser: bytes from the wire become typed events; a live port and a recording feed the same one.

No byte is dropped silently: `raw` and `take_tail` give back every byte that was fed, split after each good
packet, so a recording holds the wire exactly, damaged packets included, and a replay counts the same damage.
"""

from __future__ import annotations

from collections.abc import Iterator

from firmware_py import wire
from palpate.wire.events import Event
from palpate.wire.interpreter import Interpreter

LONGEST_BODY = 2048
"""Longest body accepted, bytes; a frame of 16 x 26 cells has 641. Longer ones are counted as oversize."""
NOISE_KEPT = 4096
"""Bytes without an event that are gathered before they are handed out as `LineNoise`; the longest packet has
fewer."""


class LineNoise(Event):
    """Bytes that no event came of: noise, damaged packets, messages that are not known here."""


class LiveParser(Interpreter):
    """Bytes in, events out, every sequence number accounted for.

    Use: `for event in parser.feed(data, host_ns)`: events in the wire's order; duplicates are dropped and
    counted. With each event `parser.raw` holds the wire's bytes since the one before (its own packet last).
    Of bytes that make no event not more than `NOISE_KEPT` are gathered: `LineNoise` then hands them out.

    Parameters
    ----------
    own_only : bool
        Results of streams that were not begun on this wire are `Earlier` from the first byte on: a live line.
        Else only once it is known which stream the wire carries: a recording may begin in the middle of one.
    """

    def __init__(self, own_only: bool = False) -> None:
        super().__init__(own_only)
        self.raw = b""
        self._receiver = wire.Receiver(LONGEST_BODY)
        self._tail = bytearray()

    def feed(self, data: bytes, host_ns: int) -> Iterator[Event]:
        """Take bytes as they came; yield what they complete.

        Parameters
        ----------
        data : bytes
            Any cut of the stream.
        host_ns : int
            When they reached the host, Unix time in ns.
        """
        receiver = self._receiver
        counts = self.counts
        n = len(data)
        counts.bytes_received += n
        start = at = 0
        while at < n:
            at = receiver.feed(data, at, n)
            if receiver.length:
                counts.packets += 1
                while at - start > NOISE_KEPT:
                    start = self._gather(data, start, at)
                    yield self._noise(host_ns)
                self.raw = bytes(self._tail) + data[start:at] if self._tail else data[start:at]
                self._tail.clear()
                start = at
                event = self.event(receiver.packet, receiver.length, host_ns)
                if event is not None:
                    yield event
                else:
                    self._tail += self.raw  # no event to go with: it goes with the next one
                    if len(self._tail) >= NOISE_KEPT:
                        yield self._noise(host_ns)
        while start < n:
            start = self._gather(data, start, n)
            if len(self._tail) >= NOISE_KEPT:
                yield self._noise(host_ns)
        counts.bad_crc = receiver.bad_crc
        counts.bad_frame = receiver.bad_frame
        counts.oversize = receiver.oversize

    def _gather(self, data: bytes, start: int, stop: int) -> int:
        """Fill the tail from data[start:stop]; returns where the rest begins."""
        end = min(stop, start + max(0, NOISE_KEPT - len(self._tail)))
        self._tail += data[start:end]
        return end

    def _noise(self, host_ns: int) -> LineNoise:
        """The bytes gathered so far, as `raw`: they wait no longer for an event to go with."""
        self.raw = self.take_tail()
        return LineNoise(host_ns)

    def take_tail(self) -> bytes:
        """The bytes after the last good packet; they are then forgotten (the link is closing)."""
        tail = bytes(self._tail)
        self._tail.clear()
        return tail
