"""How long work reports its progress."""

from __future__ import annotations

import time
from collections.abc import Callable

ProgressCallback = Callable[[str, int, int], None]
"""Called now and then with what is being done, how much of it is done and how much there is."""

SECONDS_BETWEEN_LINES = 15.0


class ProgressLines:
    """A `ProgressCallback` for files and pipes: plain lines, never two within `seconds` of each other.

    Parameters
    ----------
    write : callable
        Takes each line, without its end.
    seconds : float
        Work that is done sooner says nothing.
    clock : callable
        Seconds, from any start.
    """

    def __init__(
        self,
        write: Callable[[str], object],
        seconds: float = SECONDS_BETWEEN_LINES,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._write, self._seconds, self._clock = write, seconds, clock
        self._last = clock()

    def __call__(self, what: str, done: int, total: int) -> None:
        now = self._clock()
        if now - self._last >= self._seconds:
            self._last = now
            self._write(f"{what}: {done} of {total}")


class Steps:
    """Counts the steps of one piece of work, and reports it.

    Parameters
    ----------
    words : str
        What is being done.
    total : int
        How many steps there are.
    progress : callable, optional
        Told after each.
    """

    def __init__(self, words: str, total: int, progress: ProgressCallback | None) -> None:
        self.words, self.total, self.progress, self.done = words, total, progress, 0

    def __call__(self, what: str) -> None:
        self.done += 1
        if self.progress is not None:
            self.progress(self.words, min(self.done, self.total), self.total)
