"""The strokes of a recording, put together as a live viewer would have."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from host.errors import PalpateError
from host.link import events as link
from host.link.probe import Probe
from host.link.scale import CellScale
from host.record.reader import Recording
from host.record.replay import CALIBRATION
from host.view.assemble import Assembler
from host.view.stroke import Stroke
from host.view.translate import Translator


def calibration(recording: Recording) -> CellScale:
    """The recorded probe's calibration, or the nominal sensor's."""
    scale = CellScale()
    scale.load(recording.attachment(CALIBRATION) or b"")
    return scale


def load_strokes(path: Path) -> list[Stroke]:
    """All strokes of a recording.

    Raises
    ------
    OSError
        The file is not a readable recording; the text says why.
    """
    try:
        with Probe.open(str(path)) as probe:
            translator = Translator(calibration(Recording(path)))
            assembler = Assembler(lambda t: Stroke(number=0, visit=0, started_s=t))
            strokes: list[Stroke] = []
            for event in probe.stream():
                strokes += feed(translator, assembler, event)
            last = assembler.give_up()
            return strokes + ([last] if last is not None else [])
    except PalpateError as error:
        raise OSError(str(error)) from error


def feed(translator: Translator, assembler: Assembler, event: link.Event) -> Iterator[Stroke]:
    """Take one event of the link; gives the strokes that it finishes."""
    if isinstance(event, link.Gap):
        translator.reset()
        if (given_up := assembler.give_up()) is not None:
            yield given_up
        return
    for shown in translator.feed(event):
        if (stroke := assembler.feed(shown)) is not None:
            stroke.wall_time = event.host_ns * 1e-9
            yield stroke
