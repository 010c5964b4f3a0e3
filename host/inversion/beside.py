"""Strokes of a session as it goes by, and presses of somebody's array, fitted by one process beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from pathlib import Path

from palpate.answer.fitted import Inverted
from palpate.errors import PalpateError
from palpate.inversion.felt import NotInvertible
from palpate.inversion.kept import Felt, Kept
from palpate.inversion.recorded import FeltStrokes
from palpate.inversion.strokes import invert_stroke
from palpate.inversion.under import AUTO
from palpate.link.schemes import address_of
from palpate.sim.probe.noise import level_named
from palpate.sim.tissue.workers import pool
from palpate.wire.events import Event

Fitting = Future[Inverted]


class Beside:
    """Watches a session's events; what it finds is fitted in the order in which it came.

    Parameters
    ----------
    executor : Executor
        Where it is fitted.
    port : str
        Where the session comes from, as `FeltStrokes` takes it.
    recording : callable
        The file, if any, that the session is recorded to just now, or was: answers are kept beside it.

    Attributes
    ----------
    kept_in : Path or None
        Where answers are kept, once there is one.
    unkept : str
        Why answers could not be kept; "" where they could.
    """

    def __init__(
        self, executor: Executor, port: str, recording: Callable[[], Path | None] = lambda: None
    ) -> None:
        self._recording = recording
        self.kept_in: Path | None = None
        self.unkept = ""
        self._executor, self._strokes, self._noise = executor, FeltStrokes(port), level_named("typical")
        self._presses_too = address_of(port) is not None

    def take(self, event: Event, calibration: bytes) -> Fitting | None:
        """Watch an event go by; of the stroke that ends with it, its fit to come."""
        found = self._strokes.take(event, calibration)
        if found is None or (self._strokes.was_press and not self._presses_too):
            return None
        stroke, start = found
        if not isinstance(stroke, NotInvertible):
            kept = self._kept()
            answer = kept.find([(stroke, start)], self._noise, AUTO) if kept else None
            if answer is None:
                fitting = self._executor.submit(invert_stroke, stroke, start, self._noise)
                if kept:
                    fitting.add_done_callback(lambda done: self._keep(kept, (stroke, start), done))
                return fitting
        else:
            answer = Inverted(start.stroke, problem=str(stroke), press=self._strokes.was_press)
        known: Fitting = Future()
        known.set_result(answer)
        return known

    def _kept(self) -> Kept | None:
        path = self._recording()
        try:
            return None if path is None else Kept(path)
        except PalpateError as error:
            self.unkept = str(error)
            return None

    def _keep(self, kept: Kept, stroke: Felt, done: Fitting) -> None:
        if done.cancelled() or done.exception() is not None:
            return
        try:
            kept.keep([stroke], self._noise, AUTO, done.result())
            self.kept_in = kept.path
        except PalpateError as error:
            self.unkept = str(error)


@contextmanager
def one_process() -> Iterator[Executor]:
    """A process for it; what it is at when the block ends is finished first, unless an exception ends it."""
    with pool(1, "palpate.inversion.strokes") as executor:
        yield executor
