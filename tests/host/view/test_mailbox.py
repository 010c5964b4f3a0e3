"""What waits for a page: the newest frame, events in their order, bounded memory."""

from __future__ import annotations

import json
import threading

from palpate.view.mailbox import Mailbox
from palpate.view.session import Session
from tests.host.view.synthetic import Bump, stroke
from tests.host.view.waiting import eventually


def test_a_page_that_does_not_read_keeps_one_frame_and_it_is_the_newest():
    mailbox = Mailbox()
    for n in range(10_000):
        mailbox.put_slot("frame", n.to_bytes(4, "little"))
    assert len(mailbox) == 1
    assert mailbox.take() == [(9_999).to_bytes(4, "little")]


def test_events_keep_their_order_and_come_before_frames():
    mailbox = Mailbox()
    mailbox.put_slot("frame", b"f")
    for n in range(5):
        mailbox.put_event({"n": n})
    assert mailbox.take(with_frame=False) == [{"n": n} for n in range(5)]
    assert mailbox.take() == [b"f"]


def test_nothing_older_is_told_after_something_newer():
    """A slow page would else show a running stroke for good that is long over."""
    mailbox = Mailbox()
    mailbox.put_slot("progress", {"running": 1})
    mailbox.put_event({"finished": 1})
    mailbox.put_slot("visits", {"strokes": 1})
    mailbox.put_slot("state", {"stroke": False})
    mailbox.put_event({"link": "gone"})
    mailbox.put_slot("visits", {"strokes": 2})
    told = [*mailbox.take()]
    assert told == [{"running": 1}, {"finished": 1}, {"stroke": False}, {"link": "gone"}, {"strokes": 2}]


def test_a_page_hundreds_of_events_behind_is_told_everything_afresh():
    mailbox = Mailbox(max_events=10)
    for n in range(1000):
        mailbox.put_event({"n": n})
    assert mailbox.overflowed and len(mailbox) == 0
    mailbox.reset()
    mailbox.put_event({"n": 0})
    assert not mailbox.overflowed and mailbox.take() == [{"n": 0}]


def test_memory_stays_bounded_when_no_page_reads():
    session = Session(mode="live", name="x")
    mailbox = session.join()
    for number in range(150):
        for event in stroke(Bump(), number * 2.0, number * 15, 30.0, 0.5, number):
            session.on_event(event)
    assert len(mailbox) <= 262
    assert len(session.visits.strokes()) == 150
    assert sum(len(s.images) > 0 for s in session.visits.strokes()) <= 101


def test_events_and_snapshots_from_many_threads_do_not_meet():
    session = Session(mode="live", name="x")
    stop = threading.Event()
    seen = []
    ready = threading.Barrier(4)

    def read():
        mailbox = session.join()
        ready.wait()
        while not stop.is_set():
            seen.append(len(json.dumps(session.snapshot())))
            mailbox.take()
        session.leave(mailbox)

    readers = [threading.Thread(target=read) for _ in range(3)]
    for reader in readers:
        reader.start()
    ready.wait()
    for number in range(6):
        for event in stroke(Bump(), number * 2.0, number * 40, 20.0, 2.0, number):
            session.on_event(event)
        told = len(seen)
        eventually(lambda told=told: len(seen) > told)
    stop.set()
    for reader in readers:
        reader.join()
    assert len(session.visits.strokes()) == 6
