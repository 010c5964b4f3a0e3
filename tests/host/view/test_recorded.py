"""The page on a recording of an emulated probe."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from palpate.link.flash import flash
from palpate.link.probe import Probe
from palpate.stroke.read import load_strokes
from palpate.view.replay import ReplaySource
from palpate.wire.events import Estimate
from tests.host.view.card import numbers_of, numbers_on
from tests.host.view.pages import pick
from tests.host.view.test_stroke_races import Held
from tests.host.view.waiting import PATIENCE_S, eventually, noticed, settled

pytestmark = pytest.mark.browser


SLOWLY = 0.001


@pytest.fixture(scope="module")
def recording(strokes, public_key, images, tmp_path_factory):
    """Three strokes on MicroPython, recorded."""
    from palpate.link.session import recorded
    from palpate.sim.probe.emulated import EmulatedProbe

    path = tmp_path_factory.mktemp("recording") / "monday.mcap"
    three = [*strokes, strokes[0]]  # and no more, however long the recording goes on after the third
    with EmulatedProbe("micropython", strokes=three, public_key=public_key, roomy=True) as made:
        with Probe.open(made.port) as client:
            flash(client, images[0])
            client.set_setting("stroke_pause", 60_000)  # a busy machine's pause is not the hand's
        with recorded(made.port, path) as client:
            estimates = [e for e in client.stream(strokes=3, timeout_s=PATIENCE_S) if isinstance(e, Estimate)]
    return path, estimates


def test_at_its_end_a_recording_rests_on_its_last_stroke(recording, viewer, open_page):
    source = ReplaySource(recording[0])
    source.set_speed(50)
    page = open_page(viewer(source, mode="replay"))
    expect(page.locator("#link-text")).to_have_text("Played to its end")
    expect(page.locator("#image-note")).to_have_text("stroke 3")
    expect(page.locator("#now-peak")).not_to_have_text("–")
    source.set_speed(SLOWLY)
    page.keyboard.press("Space")
    expect(page.locator("#image-note")).to_have_text("")


def test_at_its_end_a_phone_shows_the_image_and_nothing_of_it_wraps(recording, viewer, open_page):
    """The page scrolled itself down to the list of strokes; two buttons and a menu had lines of their own."""
    source = ReplaySource(recording[0])
    source.set_speed(50)
    page = open_page(viewer(source, mode="replay"), 360, 740)
    expect(page.locator("#image-note")).to_have_text("stroke 3")
    expect(page.locator("#stroke-3")).to_have_attribute("aria-selected", "true")
    settled(page)
    assert page.evaluate("scrollY") == 0
    for row in (".brand, #link, .corner", ".image .panel-head > *"):
        middles = page.evaluate(
            """(s) => [...document.querySelectorAll(s)].map((e) => e.getBoundingClientRect())
            .map((r) => (r.top + r.bottom) / 2)""",
            row,
        )
        assert max(middles) - min(middles) < 8, row


def test_a_stroke_that_is_on_its_way_as_the_recording_ends_is_shown(recording, viewer, open_page):
    """The page went to the last stroke, and what somebody had picked was lost."""
    source, held = ReplaySource(recording[0]), Held()
    source.set_speed(SLOWLY)
    shown = viewer(source, mode="replay", load_strokes=load_strokes)
    page = open_page(shown, before=held.watch)
    expect(page.locator("#stroke-3")).to_be_visible()
    held.hold()
    page.locator("#stroke-1").click()
    held.wait(1)
    source.set_speed(50)
    expect(page.locator("#link-text")).to_have_text("Played to its end")
    held.let_go(1)
    expect(page.locator("#image-note")).to_have_text("stroke 1")


def test_a_recording_is_replayed_with_the_same_estimates(recording, viewer, open_page):
    path, estimates = recording
    page = open_page(viewer(ReplaySource(path), mode="replay"))
    expect(page.locator("#ticks .stroke")).to_have_count(3)
    page.set_viewport_size({"width": 1280, "height": 650})  # its bar lay below the window's edge
    bar = page.locator("#transport").bounding_box()
    assert bar["height"] > 20 and bar["y"] + bar["height"] <= 650
    page.set_viewport_size({"width": 1280, "height": 800})
    for number, estimate in enumerate(estimates, 1):
        pick(page, number)
        expect(page.locator("#estimate-which")).to_contain_text(f"stroke {number},")
        assert numbers_on(page) == numbers_of(estimate)
    expect(page.locator("#record")).to_be_hidden()


def test_a_recording_is_paused_wound_and_hurried(recording, viewer, open_page):
    source = ReplaySource(recording[0])
    source.set_speed(SLOWLY)  # it must not end before this page has asked for anything
    running = viewer(source, mode="replay")
    page = open_page(running)
    expect(page.locator("#ticks .stroke")).to_have_count(3)
    page.keyboard.press("Space")
    expect(page.locator("#play")).to_have_attribute("aria-label", "Play")
    eventually(lambda: not running.session.playback.playing)
    paused = running.session.playback
    eventually(lambda: running.session.playback is not paused)
    assert running.session.playback.position_s == paused.position_s
    page.locator("#seek").fill("0.5")
    expect(page.locator("#play-time")).to_have_text("0:00.5")
    page.locator("body").click(position={"x": 5, "y": 60})
    page.keyboard.press("ArrowRight")
    expect(page.locator("#play-time")).to_have_text("0:01.5")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("]")
    expect(page.locator("#speed")).to_have_value("2")
    page.locator("#speed").select_option("10")
    page.locator("body").click(position={"x": 5, "y": 60})
    page.keyboard.press("Space")
    expect(page.locator("#link-text")).to_have_text("Played to its end")
    expect(page.locator("#play")).to_have_attribute("aria-label", "Play")
    expect(page.locator("#estimate-which")).to_contain_text("stroke 3,")
    source.set_speed(SLOWLY)
    page.keyboard.press("Space")
    expect(page.locator("#play")).to_have_attribute("aria-label", "Pause")


def test_an_earlier_recording_is_loaded_as_a_visit(recording, viewer, open_page, tmp_path):
    path, estimates = recording
    folder = tmp_path / "recordings"
    folder.mkdir()
    (folder / "last-year.mcap").write_bytes(path.read_bytes())
    (folder / "broken.mcap").write_bytes(b"not a recording")
    page = open_page(viewer(ReplaySource(path), mode="replay", load_strokes=load_strokes))
    expect(page.locator("#ticks .stroke")).to_have_count(3)
    page.locator("#load-visit").click()
    page.get_by_role("button", name="broken.mcap").click()
    noticed(page, "is not a recording")
    page.locator("#load-visit").click()
    page.get_by_role("button", name="last-year.mcap").click()
    expect(page.locator("#visit-a option:checked")).to_have_text("last-year")
    expect(page.locator("#comparison .result")).to_contain_text("within repeatability")
    expect(page.locator("#strokes [data-number]")).to_have_count(2 * len(estimates))


@pytest.mark.parametrize(("name", "width", "height"), [("desk", 1280, 800), ("phone", 390, 844)])
def test_both_windows_show_the_stroke(recording, viewer, open_page, name, width, height):
    page = open_page(viewer(ReplaySource(recording[0]), mode="replay"), width, height)
    expect(page.locator("#link-text")).to_have_text("Played to its end")
    expect(page.locator("#map-legend")).to_contain_text("fit by the probe")
    page.wait_for_function(  # more than the frame and the scale
        """() => {
          const canvas = document.getElementById("image");
          const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
          const colors = new Set();
          for (let i = 0; i < data.length; i += 4) colors.add(data.slice(i, i + 3).join());
          return colors.size > 20;
        }"""
    )
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    if name == "desk":
        assert page.evaluate("(c => c.scrollHeight - c.clientHeight)(document.querySelector('#card'))") <= 1
