"""A recording of made-up bytes of the wire."""

from palpate.recording.writer import RecordingWriter
from palpate.wire.events import Event
from palpate.wire.parser import LiveParser


def record(path, data: bytes, seal=True) -> list[Event]:
    parser, events = LiveParser(), []
    writer = RecordingWriter(path)
    for event in parser.feed(data, 1_700_000_000_000_000_000):
        writer.received(parser.raw, event, event.host_ns)
        events.append(event)
    writer.received(parser.take_tail(), None, 1)
    writer.close(seal)
    return events
