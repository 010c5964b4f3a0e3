"""The strokes of a recording, put together as a live viewer would have."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from palpate.model_export.schema import ModelSpec
from palpate.recording.channels import CALIBRATION, MODEL
from palpate.recording.playback import RecordedSession, open_recording
from palpate.recording.reader import Recording
from palpate.stroke.answered import AnsweredEvents
from palpate.stroke.assemble import Assembler
from palpate.stroke.documents import Documents
from palpate.stroke.follower import Follower
from palpate.stroke.stroke import FollowedStroke
from palpate.wire.events import Event


def follower_of(recording: Recording, document: ModelSpec | None = None) -> Follower:
    """Tells width and place across of a recording's strokes."""
    documents = Documents(document)
    documents.learn(recording.attachment(MODEL) or b"")
    return Follower(documents, recording.attachment(CALIBRATION) or b"")


def load_strokes(path: Path, document: ModelSpec | None = None) -> list[FollowedStroke]:
    """All strokes of a recording.

    Raises
    ------
    PalpateError
        The file is not a readable recording; the text says why.
    """
    with open_recording(path) as session:
        return list(strokes_of(session, follower_of(session.recording, document)))


def strokes_of(
    session: RecordedSession,
    follower: Follower,
    seen: Callable[[Event], None] = lambda event: None,
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[FollowedStroke]:
    """The strokes of an open recording as they end.

    Parameters
    ----------
    session : RecordedSession
    follower : Follower
        Of `follower_of`.
    seen : callable, optional
        Called with each event before its stroke is handed out.
    stopped : callable, optional
        Asked before each event whether somebody wants no more.
    """
    answers, assembler = (
        AnsweredEvents(follower),
        Assembler(lambda t: FollowedStroke(number=0, visit=0, started_s=t)),
    )
    for event in session.events():
        if stopped():
            return
        seen(event)
        for each in answers.feed(event):
            if (stroke := assembler.feed(each)) is not None:
                stroke.wall_time = event.host_ns * 1e-9
                yield stroke
    for last in answers.finish():
        if (stroke := assembler.feed(last)) is not None:
            yield stroke
    if (given_up := assembler.give_up()) is not None:
        yield given_up
