"""Streams of a probe that strokes without end, for tests."""

from firmware_py import messages, status
from palpate.sim.probe import source
from tests.benchmarks.bench_link import Still

STROKES = messages.CONTENT_STROKES
SECOND = 1_000_000
AIR = source.lifted_record()
STROKE = AIR * 3 + source.records(Still(20)) + AIR * 3


def start(bench, content=STROKES, strokes=0, lease_ms=0):
    answer = bench.ask("stream_start", (content, 1, strokes, lease_ms))
    assert answer.code == status.OK
    return answer.fields


def run_awake(bench, us):
    """Let time pass, with a word every second."""
    news = []
    while us > 0:
        bench.ask("time_sync")
        news += bench.run(min(us, SECOND))
        us -= SECOND
    return news


def of(news, name):
    return [m.fields for m in news if m.name == name]
