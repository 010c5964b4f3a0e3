"""A field more in the frame and a number more on the card: python -m tests.another_field DIRECTORY

A test runs it in a copy of the sources that has both. Prints where they come out, as JSON.
"""

import csv
import io
import itertools
import json
import sys
from pathlib import Path

from firmware_py import outputs, tables
from palpate.link.session import recorded
from palpate.recording.channels import MOTION, read_json
from palpate.recording.convert import convert
from palpate.recording.playback import open_recording
from palpate.recording.reader import Recording
from palpate.sim.probe.emulated import EmulatedProbe
from palpate.stroke.answered import Answered
from palpate.view.exports import table
from palpate.view.session import Session
from palpate.wire.events import Estimate, Frame


def from_the_wire(directory):
    """The field as the live probe's client has it, as a recording does, and as a table does."""
    file = directory / "session.mcap"
    with EmulatedProbe("cpython") as emulated, recorded(emulated.port, file) as probe:
        probe.start_stream()
        frames = (event for event in probe.events(timeout_s=30) if isinstance(event, Frame))
        live = [frame.more for frame in itertools.islice(frames, 3)]
        probe.stop_stream()
    with open_recording(file) as session:
        replayed = next(event.more for event in session.events() if isinstance(event, Frame))
    (motion, *_) = (read_json(record.data) for topic, record in Recording(file).records() if topic == MOTION)
    convert(file, directory / "frames.csv")
    with (directory / "frames.csv").open() as stream:
        row = next(csv.DictReader(stream))
    (name,) = tables.FRAME_MORE
    return {"live": live, "replayed": replayed, "motion": motion[name], "table": row[name]}


def on_the_card():
    """The rows of a stroke's card, and the columns of the table that the page gives away."""
    flags = outputs.LUMP | outputs.IN_DOMAIN
    said = Estimate(0, 1, 1, 0, flags, 0, 900, 100, bytes(8), 0, 0, 0, 0, 0, (500_000,) * outputs.VALUES)
    session = Session(mode="live", name="x")
    session.on_event(Answered(0, said))
    (stroke,) = session.visits.strokes()
    line = next(csv.DictReader(io.StringIO(table(session.visits.snapshot()).decode())))
    return {"card": stroke.summary()["card"]["rows"], "taken": line}


if __name__ == "__main__":
    print(json.dumps({"frame": from_the_wire(Path(sys.argv[1])), "card": on_the_card()}))
