"""Many pages, the probe's thread and the end of the program at once: one recording, and none left open."""

from __future__ import annotations

import threading

import pytest

from palpate.view.commands import PageCommands
from palpate.view.notices import RecordingStopped
from palpate.view.session import Session
from tests.host.view.synthetic import Bump, SyntheticSource
from tests.host.view.waiting import PATIENCE_S, eventually


@pytest.fixture
def parts(tmp_path):
    """A source whose start can be held back, its session and commands."""
    source = SyntheticSource([Bump()], limit=0)
    session = Session(mode="live", name="x")
    source.begun, source.go_on = threading.Event(), threading.Event()
    start = source.start_recording

    def slow_start(path):
        source.begun.set()
        assert source.go_on.wait(PATIENCE_S)
        start(path)

    source.start_recording = slow_start
    yield source, session, PageCommands(session, source, tmp_path, lambda path: ())
    source.go_on.set()


def ask(commands, do, **words):
    """Ask in a thread of its own; returns the thread and the list that gets the answer."""
    answers = []
    thread = threading.Thread(target=lambda: answers.append(commands.run({"do": do, **words})), daemon=True)
    thread.start()
    return thread, answers


def test_two_pages_that_record_at_once_get_one_recording(parts):
    source, _, commands = parts
    asked = [ask(commands, "record") for _ in range(2)]
    assert source.begun.wait(PATIENCE_S)
    source.go_on.set()
    for thread, _ in asked:
        thread.join(PATIENCE_S)
    answers = [answer["ok"] for _, found in asked for answer in found]
    assert sorted(answers) == [False, True] and source.told == ["start"]


def test_a_mark_and_a_stop_asked_for_during_a_start_come_after_it(parts):
    source, session, commands = parts
    first, _ = ask(commands, "record")
    assert source.begun.wait(PATIENCE_S)
    second, stopped = ask(commands, "stop-recording")
    source.go_on.set()
    first.join(PATIENCE_S)
    second.join(PATIENCE_S)
    assert stopped[0]["ok"] and source.told == ["start", "stop"] and session.recording is None


def test_a_mark_without_a_recording_is_refused_and_not_lost_in_silence(parts):
    source, _, commands = parts
    answer = commands.run({"do": "mark", "text": "here"})
    assert not answer["ok"] and "No recording is running" in answer["text"] and source.told == []


def test_a_disk_that_is_full_at_once_leaves_no_page_that_says_recording(parts):
    """The end is told before the start is."""
    source, session, commands = parts
    page = session.join()
    start = source.start_recording

    def start_and_fill_the_disk(path):
        start(path)
        source.recording = False
        session.on_event(RecordingStopped("The recording has stopped: the disk is full."))

    source.start_recording = start_and_fill_the_disk
    source.go_on.set()
    commands.run({"do": "record"})
    shown = [m["recording"] for m in page.take() if isinstance(m, dict) and m["type"] == "recording"]
    assert session.recording is None and shown[-1] is None
    source.start_recording = start
    assert commands.run({"do": "record"})["ok"]


def test_a_viewer_that_is_closed_during_a_start_closes_the_recording_and_begins_no_other(parts):
    source, session, commands = parts
    ask(commands, "record")
    assert source.begun.wait(PATIENCE_S)
    closing = threading.Thread(target=commands.close, daemon=True)
    closing.start()
    source.go_on.set()
    closing.join(PATIENCE_S)
    eventually(lambda: source.told == ["start", "stop"], lambda: source.told)
    assert session.recording is None
    assert not commands.run({"do": "record"})["ok"]


def test_what_pages_are_told_last_of_the_recording_is_how_it_is():
    session = Session(mode="live", name="x")
    page = session.join()
    tell, first, other = session.tell, threading.Event(), threading.Event()

    def slow_tell(message):
        if not first.is_set():
            first.set()
            other.wait(0.3)  # comes at once if the other thread is let in between, else never
        tell(message)
        other.set()

    session.tell = slow_tell
    thread = threading.Thread(target=session.set_recording, args=({"file": "x", "since": 0.0},))
    thread.start()
    assert first.wait(PATIENCE_S)
    session.set_recording(None)
    thread.join()
    assert session.recording is None and page.take()[-1]["recording"] is None
