"""Strokes of a stream, and presses of somebody's array, fitted by the finite-element model beside it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from palpate.answer.fitted import Inverted
from palpate.inversion.beside import Beside, Fitting, one_process
from palpate.wire.events import Event


class Refining:
    """Gives what is fitted in the order in which it came."""

    def __init__(self, beside: Beside) -> None:
        self._beside = beside
        self._work: list[Fitting] = []

    def take(self, event: Event, calibration: bytes) -> None:
        """Watch an event go by."""
        if (fitting := self._beside.take(event, calibration)) is not None:
            self._work.append(fitting)

    def done(self) -> Iterator[Inverted]:
        """Those that are ready and were not given yet."""
        while self._work and self._work[0].done():
            yield self._work.pop(0).result()

    def kept(self) -> list[str]:
        """Where answers were kept, or why not, in words."""
        where, why = self._beside.kept_in, self._beside.unkept
        said = [f"refined answers are kept in {where}"] if where else []
        return said + ([f"refined answers were not kept: {why}"] if why else [])

    @property
    def waiting(self) -> int:
        """How many are not ready."""
        return len(self._work)

    def rest(self) -> Iterator[Inverted]:
        """All others, as they become ready."""
        while self._work:
            yield self._work.pop(0).result()


@contextmanager
def refining(port: str, record: Path | None) -> Iterator[Refining]:
    """Have a process beside this one, which ends with the block; answers are kept beside the recording."""
    with one_process() as executor:
        yield Refining(Beside(executor, port, lambda: record))
