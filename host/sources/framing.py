"""Frames of a fixed length, cut out of bytes that have a mark in each frame, and neither length nor CRC."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

KEPT_BYTES = 1 << 16


class Framing:
    """Cuts frames; a mark counts only where the next stands one frame further, for it may occur in a payload.

    Parameters
    ----------
    length : int
        Bytes of a frame, its mark included.
    mark : bytes
    at : int
        Where the mark stands in a frame.

    Attributes
    ----------
    skipped : int
        Bytes that belonged to no whole frame.
    slips : int
        Times that the frames were no longer where they had been: bytes were lost, or the array was reset.
    """

    def __init__(self, length: int, mark: bytes, at: int = 0) -> None:
        self.length, self.mark, self.at = length, mark, at
        self.skipped = self.slips = 0
        self._buffer = bytearray()
        self._locked = False
        self._seen = bytearray()
        self._frames = 0

    def feed(self, data: bytes) -> list[bytes]:
        """The frames that are whole now, each with its mark."""
        self._buffer += data
        if not self._frames:
            self._seen = (self._seen + data)[-KEPT_BYTES:]
        found: list[bytes] = []
        while len(self._buffer) >= self.length:
            if self._locked and self._marked(0):
                found.append(bytes(self._buffer[: self.length]))
                del self._buffer[: self.length]
                continue
            if self._locked:
                self._locked, self.slips = False, self.slips + 1
            if not self._find():
                break
        self._frames += len(found)
        return found

    def complaint(self, cells: str) -> str:
        """Why there has been no frame: the sentence's end. `cells` says how many were expected."""
        if not self._seen:
            return "nothing comes: is it switched on, and is this its port?"
        spacing = self._spacing()
        if spacing is None:
            mark = self.mark.hex(" ")
            return f"bytes came, but not the mark {mark} in each frame: another baud rate, or device?"
        return f"its frames have {spacing} bytes, and {cells} would take {self.length}: check rows and cols"

    def _marked(self, place: int) -> bool:
        start = place + self.at
        return self._buffer[start : start + len(self.mark)] == self.mark

    def _find(self) -> bool:
        """Skip to where two marks stand a frame apart; False while there is no such place."""
        place = 0
        while place + self.length + self.at + len(self.mark) <= len(self._buffer):
            if self._marked(place) and self._marked(place + self.length):
                break
            place += 1
        else:
            self._drop(place)
            return False
        self._drop(place)
        self._locked = True
        return True

    def _drop(self, n: int) -> None:
        self.skipped += n
        del self._buffer[:n]

    def _spacing(self) -> int | None:
        """How far apart most marks stand."""
        places, at = [], self._seen.find(self.mark)
        while at >= 0:
            places.append(at)
            at = self._seen.find(self.mark, at + 1)
        apart = Counter(b - a for a, b in pairwise(places))
        common = apart.most_common(1)
        return common[0][0] if common and common[0][1] >= 3 else None
