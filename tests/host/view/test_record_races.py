"""Records and marks in any order with their answers: what the reader asked for last is what happens."""

from __future__ import annotations

import errno
import os

import pytest
from playwright.sync_api import expect

from palpate.view.notices import RecordingStopped
from tests.host.view.pages import LUMP, opened, told
from tests.host.view.synthetic import SyntheticSource
from tests.host.view.waiting import eventually, held, noticed, recording_begun

pytestmark = pytest.mark.browser


@pytest.mark.parametrize("done", [True, False], ids=["the page shows Stop", "the page shows Record"])
def test_a_mark_is_asked_for_at_once_while_the_start_is_still_on_its_way(viewer, open_page, done):
    source = SyntheticSource([LUMP], limit=0)
    running, page = opened(viewer, open_page, source)
    with held(running, "record", done=done) as start:
        page.keyboard.press("r")
        eventually(start.arrived.is_set)
        expect(page.locator("#record-text")).to_contain_text("Stop" if done else "Record")
        page.keyboard.press("m")
        page.keyboard.type("here")
        expect(page.locator("#text-value")).to_have_value("here")
        page.keyboard.press("Enter")
        page.keyboard.press("r")
        start.let_go()
        told(source, ["start", "mark here", "stop"])
    expect(page.locator("#record-text")).to_have_text("Record")


def test_a_mark_after_a_stop_that_is_still_on_its_way_has_no_place(viewer, open_page):
    source = SyntheticSource([LUMP], limit=0)
    running, page = opened(viewer, open_page, source)
    recording_begun(page)
    with held(running, "stop-recording", done=False):
        page.keyboard.press("r")
        page.keyboard.press("m")
        noticed(page, "Press R to record")
        expect(page.locator("#dialog-text")).to_be_hidden()
    told(source, ["start", "stop"])


def test_a_key_pressed_before_the_page_knows_what_it_shows_waits_for_that(viewer, open_page):
    source = SyntheticSource([LUMP], limit=0)
    page = open_page(viewer(source), script=HOLD_THE_GREETING)
    page.keyboard.press("r")
    page.keyboard.press(" ")
    assert source.told == []
    page.evaluate("greet()")
    told(source, ["start"])
    noticed(page, "Recording to")
    assert not page.evaluate("toasts.some((toast) => toast.includes('held'))")


HOLD_THE_GREETING = """
const early = [];
window.WebSocket = class extends WebSocket {
  constructor(...words) {
    super(...words);
    this.addEventListener("message", (event) => {
      if (!early.waits) return;
      event.stopImmediatePropagation();
      early.push(event.data);
    });
  }
};
early.waits = true;
window.greet = () => {
  early.waits = false;
  for (const data of early.splice(0)) sockets.at(-1).dispatchEvent(new MessageEvent("message", { data }));
};
"""


def test_a_start_that_failed_is_tried_again_by_the_next_press(viewer, open_page):
    source = SyntheticSource([LUMP], limit=0)
    start, full = source.start_recording, [OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))]

    def start_on_a_full_disk(path):
        if full:
            raise full.pop()
        start(path)

    source.start_recording = start_on_a_full_disk
    _, page = opened(viewer, open_page, source)
    page.keyboard.press("m")
    noticed(page, "Press R to record")
    page.keyboard.press("r")
    noticed(page, "No space left on device")
    page.keyboard.press("r")
    told(source, ["start"])
    expect(page.locator("#record-text")).to_contain_text("Stop")


def test_a_recording_that_ended_by_itself_while_a_mark_was_written_can_be_begun_again(viewer, open_page):
    source = SyntheticSource([LUMP], limit=0)
    running, page = opened(viewer, open_page, source)
    recording_begun(page)
    page.keyboard.press("m")
    source.recording = False
    running.session.on_event(RecordingStopped("The recording has stopped: the disk is full."))
    noticed(page, "the disk is full")
    page.keyboard.type("too late")
    page.keyboard.press("Enter")
    noticed(page, "the mark has no place")
    page.keyboard.press("r")
    told(source, ["start", "start"])


def test_two_marks_in_one_breath_keep_their_texts(viewer, open_page):
    """The second dialog opens before the browser has told that the first was closed."""
    source = SyntheticSource([LUMP], limit=0)
    _, page = opened(viewer, open_page, source)
    recording_begun(page)
    page.keyboard.press("m")
    page.keyboard.type("one")
    page.evaluate("""() => {
      const dialog = document.getElementById("dialog-text");
      dialog.querySelector("form").requestSubmit(dialog.querySelector("[value=ok]"));
      document.body.dispatchEvent(new KeyboardEvent("keydown", { key: "m", bubbles: true }));
    }""")
    page.keyboard.type("two")
    page.keyboard.press("Enter")
    told(source, ["start", "mark one", "mark two"])


def test_a_key_that_is_held_down_records_once(viewer, open_page):
    source = SyntheticSource([LUMP], limit=0)
    _, page = opened(viewer, open_page, source)
    page.keyboard.down("r")
    page.keyboard.down("r")  # the keyboard repeats it
    page.keyboard.down("r")
    page.keyboard.up("r")
    page.keyboard.press("m")
    page.keyboard.press("Enter")
    told(source, ["start", "mark mark"])


def test_a_connection_lost_while_a_start_is_answered_leaves_a_page_that_can_stop_it(viewer, open_page):
    source = SyntheticSource([LUMP], limit=0)
    running, page = opened(viewer, open_page, source)
    with held(running, "record") as start:
        page.keyboard.press("r")
        eventually(start.arrived.is_set)
        page.evaluate("sockets.at(-1).close()")
        page.wait_for_function("() => sockets.length === 2")
        expect(page.locator("body")).to_have_attribute("data-link", "connected")
        expect(page.locator("#record-text")).to_contain_text("Stop")
    page.keyboard.press("r")
    told(source, ["start", "stop"])
