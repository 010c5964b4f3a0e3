"""Strokes on the page, fitted by the finite-element model beside it.

One process works on them in the order in which they came. Of each stroke the page is told that it is being
refined, then what came of it, in the words of its card.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from palpate.answer.fitted import ROWS, TITLES, Inverted, Laid, Value
from palpate.inversion.beside import Beside, Fitting, one_process
from palpate.recording.channels import CALIBRATION
from palpate.recording.playback import open_recording
from palpate.stroke.answered import Answered
from palpate.view.notices import Refined
from palpate.view.source import Emit
from palpate.wire.events import Estimate, Event


def watch(beside: Beside, event: Event, calibration: bytes, emit: Emit) -> None:
    """Watch an event go by; `emit` is told of its stroke, from another thread once it is fitted."""
    fitting = beside.take(event, calibration)
    if fitting is None or not isinstance(event, Estimate):  # presses alone have no card
        return
    of = event.time_us
    if not fitting.done():
        emit(Refined(of, {"working": True}))

    def fitted(work: Fitting) -> None:
        try:
            emit(Refined(of, refined_card(work.result())))
        except CancelledError:
            pass  # the page has gone
        except Exception as error:  # the page must say what happened, whatever it was
            emit(Refined(of, {"problem": f"Not refined: {error}."}))

    fitting.add_done_callback(fitted)


Sees = Callable[[Emit, threading.Event], Emit]
"""Given where a source's events go, and what stops it: where they are to go."""


@contextmanager
def refining_live(
    port: str, calibration: Callable[[], bytes], recording: Callable[[], Path | None]
) -> Iterator[Sees]:
    """Strokes of a probe; what is not fitted when the block ends is left."""
    with _left() as executor:
        beside = Beside(executor, port, recording)

        def sees(emit: Emit, _: threading.Event) -> Emit:
            def both(event: Any) -> None:
                emit(event)
                wire = event.estimate if isinstance(event, Answered) else event
                if isinstance(wire, Event):
                    watch(beside, wire, calibration(), emit)

            return both

        yield sees


@contextmanager
def refining_recorded(path: Path) -> Iterator[Sees]:
    """Strokes of a recording, all of them, whatever is played of it."""
    with _left() as executor:

        def sees(emit: Emit, stop: threading.Event) -> Emit:
            def read() -> None:
                with open_recording(path) as session:
                    port = session.recording.metadata().get("session", {}).get("port", "")
                    calibration = session.recording.attachment(CALIBRATION) or b""
                    beside = Beside(executor, port, lambda: path)
                    for event in session.events():
                        if stop.is_set():
                            return
                        watch(beside, event, calibration, emit)

            threading.Thread(target=read, name="refining", daemon=True).start()
            return emit

        yield sees


class _Left(BaseException):
    """Ends the pool as an interrupt does: it would wait for what it is at."""


@contextmanager
def _left() -> Iterator[Executor]:
    try:
        with one_process() as executor:
            yield executor
            raise _Left
    except _Left:
        pass


def refined_card(one: Inverted) -> dict[str, Any]:
    """What the page shows of a fitted stroke: title, rows, and whether it fits, in words."""
    if one.problem:
        return {"problem": f"Not refined: {one.problem}."}
    return {
        "title": TITLES[one.kind],
        "fits": one.fits,
        "text": one.verdict,
        "rows": [_row(*row, one.values[row[0]]) for row in ROWS if row[0] in one.values],
        "hardness": one.hardness if one.lump else None,
        "odds": one.odds,
        "misfit": one.chi2,
        "laid": _laid(one.laid[0]) if one.laid else None,
        "settled": one.settled,
    }


def _laid(laid: Laid) -> dict[str, Any]:
    """The stroke itself, in the order of its places: pressures row by row."""
    along = np.arange(laid.press, len(laid.place_mm))
    along = along[np.argsort(laid.place_mm[along], kind="stable")]
    shown = {
        "position_mm": laid.place_mm[along],
        "measured_kPa": laid.measured_kPa[along].T,
        "fitted_kPa": laid.fitted_kPa[along].T,
    }
    return {name: np.round(values, 3).tolist() for name, values in shown.items()}


def _row(key: str, label: str, unit: str, value: Value) -> dict[str, Any]:
    return {"key": key, "label": label, "unit": unit, **value.as_dict()}
