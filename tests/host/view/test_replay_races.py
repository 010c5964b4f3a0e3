"""Keys and sliders of a replay in any order with what it tells: what the reader asked for last holds."""

from __future__ import annotations

from dataclasses import replace

import pytest
from playwright.sync_api import expect

from palpate.view.notices import LinkChanged, LinkState
from tests.host.view.pages import opened
from tests.host.view.synthetic import SyntheticReplay
from tests.host.view.waiting import eventually, held

pytestmark = pytest.mark.browser


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
