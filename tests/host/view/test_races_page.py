"""Keys, clicks, answers and broadcasts in any order: what the reader asked for last is what the page does.

Answers are held back where they would else come too soon to matter; nothing here waits for a time.
"""

from __future__ import annotations

import errno
import os
from dataclasses import replace

import pytest
from playwright.sync_api import expect

from palpate.view.events import LinkChanged, LinkState, RecordingStopped
from tests.host.view.chromium import free_port
from tests.host.view.synthetic import Bump, SyntheticReplay, SyntheticSource
from tests.host.view.waiting import eventually, held, noticed, recording_begun, settled

pytestmark = pytest.mark.browser

LUMP = Bump(d_mm=10.0, h=0.8)


def told(source: SyntheticSource, wanted: list[str]) -> None:
    """Wait until the page has asked for all this, and find that it asked for nothing else."""
    eventually(lambda: len(source.told) >= len(wanted), lambda: source.told)
    assert source.told == wanted


def opened(viewer, open_page, source, mode="live", **words):
    """A page that has been told how things stand."""
    running = viewer(source, mode=mode, **words)
    page = open_page(running)
    expect(page.locator("body")).to_have_attribute("data-link", "connected")
    return running, page


# ---- recording and marks


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


# ---- strokes


def picks(page, count):
    """Hold the answers with strokes back; returns them by number as they are asked for."""
    waiting = {}
    page.route(
        "**/api/stroke-*.json", lambda route: waiting.update({int(number_of(route.request.url)): route})
    )

    def wait() -> dict:
        for _ in range(600):
            if len(waiting) >= count:
                return waiting
            page.wait_for_timeout(100)
        raise AssertionError(waiting)

    return wait


def number_of(url: str) -> str:
    return url.rpartition("stroke-")[2].removesuffix(".json")


def test_of_strokes_picked_in_quick_succession_the_last_is_shown_whatever_comes_first(viewer, open_page):
    source = SyntheticSource([LUMP, Bump(d_mm=20.0), Bump(d_mm=15.0)], seconds=0.3, rest=0.0, limit=3)
    _, page = opened(viewer, open_page, source)
    expect(page.locator("#stroke-3")).to_be_visible()
    wait = picks(page, 3)
    for _ in range(3):
        page.keyboard.press("ArrowDown")
    expect(page.locator("#stroke-1")).to_have_attribute("aria-selected", "true")
    routes = wait()
    for number in (1, 3, 2):
        with page.expect_response(f"**/api/stroke-{number}.json") as answer:
            routes[number].continue_()
        answer.value.finished()
    expect(page.locator("#estimate-which")).to_contain_text("stroke 1,")
    settled(page)
    expect(page.locator("#estimate-which")).to_contain_text("stroke 1,")
    expect(page.locator("#image-note")).to_have_text("stroke 1")


def test_escape_also_takes_back_a_stroke_that_is_still_on_its_way(viewer, open_page):
    source = SyntheticSource([LUMP, Bump(d_mm=20.0)], seconds=0.3, rest=0.0, limit=2)
    _, page = opened(viewer, open_page, source)
    expect(page.locator("#estimate-which")).to_contain_text("stroke 2,")
    wait = picks(page, 1)
    page.locator("#stroke-1").click()
    routes = wait()
    expect(page.locator("#back-live")).to_be_visible()
    page.keyboard.press("Escape")
    with page.expect_response("**/api/stroke-1.json") as answer:
        routes[1].continue_()
    answer.value.finished()
    settled(page)
    expect(page.locator("#back-live")).to_be_hidden()
    expect(page.locator("#estimate-which")).to_contain_text("stroke 2,")
    expect(page.locator("#stroke-1")).to_have_attribute("aria-selected", "false")


def test_a_stroke_that_ends_while_the_last_one_is_fetched_is_not_replaced_by_it(viewer, open_page):
    source = SyntheticSource([LUMP, Bump(d_mm=20.0)], seconds=0.3, rest=0.0, limit=1)
    _, page = opened(viewer, open_page, source)
    expect(page.locator("#estimate-which")).to_contain_text("stroke 1,")
    wait = picks(page, 1)
    page.reload()
    routes = wait()
    source.limit = 2
    expect(page.locator("#estimate-which")).to_contain_text("stroke 2,")
    with page.expect_response("**/api/stroke-1.json") as answer:
        routes[1].continue_()
    answer.value.finished()
    settled(page)
    expect(page.locator("#estimate-which")).to_contain_text("stroke 2,")


def test_the_picture_can_be_held_and_let_go_before_there_is_any_stroke(viewer, open_page):
    source = SyntheticSource([LUMP], seconds=0.3, limit=0)
    _, page = opened(viewer, open_page, source)
    page.keyboard.press(" ")
    page.keyboard.press(" ")
    noticed(page, "Live again")
    source.limit = 1
    expect(page.locator("#card .verdict")).to_have_text("Lump found")


def test_letting_the_picture_go_leaves_a_picked_stroke_where_it_is(viewer, open_page):
    source = SyntheticSource([LUMP, Bump(d_mm=20.0)], seconds=0.3, rest=0.0, limit=2)
    _, page = opened(viewer, open_page, source)
    page.locator("#stroke-1").click()
    expect(page.locator("#estimate-which")).to_contain_text("stroke 1,")
    page.keyboard.press(" ")
    page.keyboard.press(" ")
    noticed(page, "Live again")
    expect(page.locator("#estimate-which")).to_contain_text("stroke 1,")


def test_a_stroke_that_comes_while_a_finger_is_on_another_does_not_take_its_place(viewer, open_page):
    source = SyntheticSource([LUMP, Bump(d_mm=20.0)], seconds=0.3, rest=0.0, limit=1)
    _, page = opened(viewer, open_page, source)
    page.locator("#stroke-1").hover()
    page.mouse.down()
    source.limit = 2
    expect(page.locator("#stroke-2")).to_be_visible()
    page.mouse.up()
    expect(page.locator("#stroke-1")).to_have_attribute("aria-selected", "true")
    expect(page.locator("#estimate-which")).to_contain_text("stroke 1,")


# ---- replay


def follows(page, source: SyntheticReplay, position_s: float, text: str) -> None:
    """The page shows where the replay stands, which it tells again and again, as a real one does."""

    def shown() -> bool:
        source.emit(replace(source.now, position_s=position_s))
        return page.locator("#play-time").inner_text() == text

    eventually(shown)


def test_keys_in_a_replay_add_up_whatever_it_told_meanwhile(viewer, open_page):
    source = SyntheticReplay()
    running, page = opened(viewer, open_page, source, "replay")
    before = source.now

    def tell_late() -> None:
        """What it told before it applied the command, and then something that can be seen."""
        source.emit(before)
        source.emit(LinkChanged(LinkState.GONE, "Told late."))
        expect(page.locator("#banner")).to_have_text("Told late.")
        source.emit(LinkChanged(LinkState.CONNECTED, ""))
        expect(page.locator("#banner")).to_be_hidden()

    for key, name in (("ArrowRight", "seek"), ("]", "speed"), (" ", "play")):
        with held(running, name) as answer:
            page.keyboard.press(key)
            eventually(answer.arrived.is_set)
            tell_late()
        tell_late()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("]")
    page.keyboard.press(" ")
    eventually(lambda: source.now.commands_applied == 6, lambda: source.now)
    assert (source.now.position_s, source.now.speed, source.now.playing) == (2.0, 5.0, False)
    follows(page, source, 7.0, "0:07.0")
    expect(page.locator("#speed")).to_have_value("5")
    expect(page.locator("#play")).to_have_attribute("aria-label", "Play")


def test_two_presses_of_space_in_one_breath_play_and_pause(viewer, open_page):
    source = SyntheticReplay()
    running, page = opened(viewer, open_page, source, "replay")
    with held(running, "play") as play:
        page.keyboard.press(" ")
        page.keyboard.press(" ")
        eventually(play.arrived.is_set)
        expect(page.locator("#play")).to_have_attribute("aria-label", "Play")
    eventually(lambda: source.now.commands_applied == 2, lambda: source.now)
    assert not source.now.playing


def test_a_control_that_failed_gives_the_page_back_to_what_is_told(viewer, open_page):
    source = SyntheticReplay()
    running, page = opened(viewer, open_page, source, "replay")
    with held(running, "seek") as seek:
        page.keyboard.press("ArrowRight")
        eventually(seek.arrived.is_set)
        expect(page.locator("#play-time")).to_have_text("0:01.0")
        page.evaluate("sockets.at(-1).close()")
        page.wait_for_function("() => sockets.length === 2")
        expect(page.locator("body")).to_have_attribute("data-link", "connected")
    follows(page, source, 9.0, "0:09.0")


def test_a_slider_that_is_dragged_and_put_back_follows_the_replay_again(viewer, open_page):
    """The browser tells of no change then."""
    source = SyntheticReplay()
    _, page = opened(viewer, open_page, source, "replay")
    page.evaluate("""() => {
      const slider = document.getElementById("seek");
      slider.dispatchEvent(new InputEvent("input"));
      slider.dispatchEvent(new PointerEvent("pointerup"));
    }""")
    eventually(lambda: source.now.commands_applied == 1, lambda: source.now)
    follows(page, source, 30.0, "0:30.0")


def test_a_slider_that_has_the_focus_leaves_other_keys_to_the_page(viewer, open_page):
    source = SyntheticReplay()
    _, page = opened(viewer, open_page, source, "replay")
    page.locator("#seek").focus()
    page.keyboard.press(" ")
    eventually(lambda: source.now.playing)


# ---- visits


def test_a_comparison_that_comes_late_does_not_replace_that_of_the_visits_now_chosen(viewer, open_page):
    source = SyntheticSource([LUMP, Bump(d_mm=10.4)], seconds=0.3, rest=0.0, limit=2)
    running, page = opened(viewer, open_page, source)
    expect(page.locator("#stroke-2")).to_be_visible()
    with held(running, "compare") as answer:
        page.keyboard.press("v")
        page.keyboard.press("Enter")
        eventually(answer.arrived.is_set)
        page.locator("#visit-b").select_option(label="This visit")
        expect(page.locator("#comparison")).to_contain_text("Begin a new visit")
    page.locator("#record").click()
    noticed(page, "Recording to")  # answers come in turn: that of the comparison is here
    expect(page.locator("#comparison")).to_contain_text("Begin a new visit")


def test_a_visit_being_loaded_holds_up_nothing_and_does_not_undo_a_choice_made_meanwhile(
    viewer, open_page, tmp_path
):
    folder = tmp_path / "recordings"
    folder.mkdir()
    (folder / "last-year.mcap").write_bytes(b"")
    source = SyntheticSource([LUMP], seconds=0.3, rest=0.0, limit=1)
    running, page = opened(
        viewer, open_page, source, load_strokes=lambda path: running.session.visits.strokes()
    )
    expect(page.locator("#stroke-1")).to_be_visible()
    page.keyboard.press("v")
    page.locator("#text-value").fill("in spring")
    page.keyboard.press("Enter")
    expect(page.locator("#visit-b option:checked")).to_have_text("in spring")
    with held(running, "load-visit", done=False) as load:
        page.locator("#load-visit").click()
        page.get_by_role("button", name="last-year.mcap").click()
        eventually(load.arrived.is_set)
        noticed(page, "Reading last-year.mcap")
        page.keyboard.press("r")
        told(source, ["start"])
        page.locator("#visit-a").select_option(label="in spring")
    noticed(page, "1 stroke loaded")
    expect(page.locator("#visit-b option")).to_have_count(3)
    expect(page.locator("#visit-a option:checked")).to_have_text("in spring")


def test_the_list_of_recordings_opens_at_once_and_stays_closed_once_closed(viewer, open_page):
    running, page = opened(viewer, open_page, SyntheticSource([LUMP], limit=0))
    with held(running, "recordings") as answer:
        page.locator("#load-visit").click()
        expect(page.locator("#dialog-load")).to_be_visible()
        page.keyboard.press("Escape")
        expect(page.locator("#dialog-load")).to_be_hidden()
        eventually(answer.arrived.is_set)
    page.keyboard.press("v")
    expect(page.locator("#dialog-text")).to_be_visible()
    expect(page.locator("#dialog-load")).to_be_hidden()


# ---- another viewer program


def test_a_new_viewer_behind_the_same_address_begins_with_an_empty_page(viewer, open_page):
    port = free_port()
    first = viewer(SyntheticSource([LUMP, Bump(d_mm=20.0)], seconds=0.3, rest=0.0, limit=2), port=port)
    page = open_page(first)
    expect(page.locator("#stroke-2")).to_be_visible()
    page.locator("#stroke-1").click()
    expect(page.locator("#estimate-which")).to_contain_text("stroke 1,")
    first.__exit__()
    expect(page.locator("#link-text")).to_have_text("Viewer stopped")
    source = SyntheticSource([Bump(d_mm=15.0)], seconds=0.3, limit=0)
    viewer(source, port=port, token=first.token)
    expect(page.locator("#card")).to_contain_text("No stroke yet.")
    expect(page.locator("#strokes")).to_contain_text("Strokes are listed here as they end.")
    expect(page.locator("#back-live")).to_be_hidden()
    expect(page.locator("#export-png")).not_to_have_attribute("href", "/api/stroke-1.png")
    source.limit = 1
    expect(page.locator('[data-key="d_mm"]')).to_contain_text("15.0")
