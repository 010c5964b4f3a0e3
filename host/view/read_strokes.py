"""The strokes of a recording, put together as a live viewer would have."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from palpate.across.documents import Documents
from palpate.across.follower import Follower
from palpate.link import events as link
from palpate.link.scale import CellScale
from palpate.model_export.schema import ModelSpec
from palpate.recording.playback import open_recording
from palpate.recording.reader import Recording
from palpate.recording.replay import CALIBRATION, MODEL
from palpate.view.assemble import Assembler
from palpate.view.stroke import Stroke
from palpate.view.translate import Translator


def calibration(recording: Recording) -> CellScale:
    """The recorded probe's calibration, or the nominal sensor's."""
    scale = CellScale()
    scale.load(recording.attachment(CALIBRATION) or b"")
    return scale


def follower_of(recording: Recording, document: ModelSpec | None = None) -> Follower:
    """Tells width and place across of a recording's strokes."""
    documents = Documents(document)
    documents.learn(recording.attachment(MODEL) or b"")
    return Follower(documents, recording.attachment(CALIBRATION) or b"")


def load_strokes(path: Path, document: ModelSpec | None = None) -> list[Stroke]:
    """All strokes of a recording.

    Raises
    ------
    PalpateError
        The file is not a readable recording; the text says why.
    """
    with open_recording(path) as session:
        translator = Translator(calibration(session.recording), follower_of(session.recording, document))
        assembler = Assembler(lambda t: Stroke(number=0, visit=0, started_s=t))
        strokes: list[Stroke] = []
        for event in session.events():
            strokes += feed(translator, assembler, event)
        for shown in translator.finish():
            strokes += [stroke] if (stroke := assembler.feed(shown)) is not None else []
        last = assembler.give_up()
        return strokes + ([last] if last is not None else [])


def feed(translator: Translator, assembler: Assembler, event: link.Event) -> Iterator[Stroke]:
    """Take one event of the link; gives the strokes that it finishes."""
    if isinstance(event, link.Gap):
        for shown in translator.finish():
            if (stroke := assembler.feed(shown)) is not None:
                yield stroke
        translator.reset()
        if (given_up := assembler.give_up()) is not None:
            yield given_up
        return
    for shown in translator.feed(event):
        if (stroke := assembler.feed(shown)) is not None:
            stroke.wall_time = event.host_ns * 1e-9
            yield stroke
