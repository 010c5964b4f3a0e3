"""Place and depth from a second port: lines of text, each a place in mm, or a place and a depth.

They are joined to the images by their times of arrival. Between two lines the place goes straight; after
the last it goes on for `AHEAD_US`, then it stands, and the frames that this concerns are counted.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise

from palpate.errors import PortError
from palpate.link.transport import Transport

AHEAD_US = 50_000.0
GAP_US = 300_000.0
"""So long without a line is a gap."""
_KEPT = 256
_LONGEST = 200
_FARTHEST_MM = 10_000.0


class PlaceSource:
    """Reads an open port.

    Parameters
    ----------
    name : str
        The port's.
    transport : Transport
        Closed with it.

    Attributes
    ----------
    lines, odd : int
        Lines that were places, and lines that were none.
    without : int
        Frames that found no line near their time.
    """

    def __init__(self, name: str, transport: Transport) -> None:
        self.name, self._transport = name, transport
        self.lines = self.odd = self.without = 0
        self._text = b""
        self._seen: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)

    def look(self, now_us: float, timeout_s: float = 0.0) -> None:
        """Take what has come; raises LinkGone where the port vanished."""
        *lines, rest = (self._text + self._transport.read(timeout_s)).split(b"\n")
        self._text = rest[-_LONGEST:]
        for line in lines:
            try:
                place, depth = ([float(word) for word in line.replace(b",", b" ").split()] + [0.0])[:2]
            except ValueError:
                self.odd += 1
                continue
            if max(abs(place), abs(depth)) > _FARTHEST_MM or place != place or depth != depth:
                self.odd += 1
                continue
            self.lines += 1
            self._seen.append((now_us, place, depth))

    def check(self) -> None:
        """PortError unless a place has come by now."""
        if not self.lines:
            why = f"{self.odd} lines came, and none is a place in mm" if self.odd or self._text else "no line"
            raise PortError(self.name, f"{self.name} gives no places: {why}; send lines as 12.5 or 12.5,3.1")

    def at(self, time_us: float) -> tuple[float, float]:
        """Place and depth in mm at a time of the recent past."""
        seen = self._seen
        if not seen:
            self.without += 1
            return 0.0, 0.0
        before, after = seen[-2] if len(seen) > 1 else seen[-1], seen[-1]
        if time_us < after[0]:
            before, after = next((p for p in pairwise(seen) if p[1][0] >= time_us), (seen[0], seen[0]))
        length = after[0] - before[0]
        if length > GAP_US or time_us - after[0] > GAP_US:
            self.without += 1
        share = (min(time_us, after[0] + AHEAD_US) - before[0]) / length if length > 0 else 1.0
        share = max(share, 0.0)
        return tuple(a + share * (b - a) for a, b in zip(before[1:], after[1:]))  # type: ignore[return-value]

    def close(self) -> None:
        """Give the port back."""
        self._transport.close()
