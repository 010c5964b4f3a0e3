"""What must not jump from stroke to stroke: a page that stood still, colours, axes."""

from __future__ import annotations

import re
import threading
import time

import numpy as np
import pytest
from playwright.sync_api import expect

from palpate.view.notices import LinkChanged, LinkState
from palpate.view.page_connection import MAX_UNDRAWN
from tests.host.view.pages import LUMP
from tests.host.view.synthetic import DEVICE, Bump, SyntheticSource, frame, state
from tests.host.view.waiting import eventually, settled

pytestmark = pytest.mark.browser


KEEP_NUMBERS = """
window.seqs = [];
window.WebSocket = class extends WebSocket {
  constructor(...words) {
    super(...words);
    this.addEventListener("message", ({ data }) => {
      if (data instanceof ArrayBuffer) seqs.push(new DataView(data).getUint32(4, true));
    });
  }
};
"""


def test_of_a_fast_stream_a_page_that_stood_still_gets_what_is_now_and_not_what_was(viewer, open_page):
    source = SyntheticSource([LUMP], rate=200.0, seconds=3.0, rest=0.0)
    page = open_page(viewer(source), script=KEEP_NUMBERS)
    page.wait_for_function("() => seqs.length > 20")
    with page.expect_event("dialog") as dialog:
        page.evaluate("() => void setTimeout(() => alert('nothing is drawn while this is open'))")
    begin = source.seq
    eventually(lambda: source.seq > begin + 300)
    end = source.seq
    dialog.value.accept()
    page.wait_for_function("(end) => seqs.at(-1) >= end", arg=end)
    seqs = page.evaluate("seqs")
    assert seqs == sorted(seqs)
    assert sum(begin < seq < end for seq in seqs) <= MAX_UNDRAWN


def test_a_colour_means_one_pressure_for_five_strokes_and_then_the_scale_shrinks(viewer, open_page):
    """The automatic scale hopped within a stroke, so that 4.7 kPa was yellow and the lump's 5.4 kPa green."""
    high, low = Bump(base_kPa=4.0, amp_kPa=1.5), Bump(base_kPa=1.0, amp_kPa=0.3)
    source = SyntheticSource([high, low, low, low, low, low], seconds=0.2, rest=0.0, limit=1)
    page = open_page(viewer(source))
    page.locator("#view").select_option("pressure")
    image = page.locator("#image")
    expect(page.locator("#stroke-1")).to_be_visible()
    expect(image).to_have_attribute("data-top-kpa", "6")
    source.limit = 5
    expect(page.locator("#stroke-5")).to_be_visible()
    settled(page)
    expect(image).to_have_attribute("data-top-kpa", "6")
    source.limit = 6
    expect(image).to_have_attribute("data-top-kpa", "2")


def test_over_a_lump_the_image_shows_the_rise_and_tells_the_value_of_a_cell(viewer, open_page):
    source = SyntheticSource([Bump(base_kPa=4.0, amp_kPa=1.0)], seconds=0.4, rest=0.0, limit=1)
    page = open_page(viewer(source))
    image = page.locator("#image")
    page.locator("#stroke-1").click()
    expect(image).to_have_attribute("data-view", "rise")
    over_lump = page.locator("#scrub-range").input_value()
    assert float(image.get_attribute("data-top-kpa")) <= 1.5
    image.focus()
    page.keyboard.press("ArrowUp")
    expect(page.locator("#cell")).to_have_text(
        re.compile(r"^at 0\.8, 0\.8 mm: [45]\.\d\d kPa, \+\d\.\d\d over base$")
    )
    page.keyboard.press("ArrowLeft")
    expect(page.locator("#cell")).to_contain_text("at \u22120.8, 0.8 mm")
    assert page.locator("#scrub-range").input_value() == over_lump  # the arrow keys were the image's
    page.locator("#view").select_option("pressure")
    expect(image).to_have_attribute("data-top-kpa", "5")
    page.locator("#contrast summary").click()
    page.locator("#high").fill("50")
    expect(image).to_have_attribute("data-high-kpa", "2.5")
    page.keyboard.press("Escape")
    assert page.locator("#contrast").evaluate("e => e.open") is False


class InTheAir(SyntheticSource):
    """A probe that touches nothing until `pressed` is set; in the air its cells are a little off zero."""

    def __init__(self) -> None:
        super().__init__([LUMP])
        self.pressed = threading.Event()

    def run(self, emit, stop):
        emit(LinkChanged(LinkState.CONNECTED, "Connected.", DEVICE))
        while not stop.wait(0.05):
            on = self.pressed.is_set()
            now, pressure = time.monotonic(), np.full((16, 26), 3.0 if on else 0.02, np.float32)
            emit(state(now, "contact" if on else "lifted"))
            emit(frame(self.seq, now, 0.0, 0.0, pressure))
            self.seq += 1


def test_a_probe_at_rest_says_so_and_shows_no_plain_purple(viewer, open_page):
    source = InTheAir()
    page = open_page(viewer(source))
    image = page.locator("#image")
    expect(image).to_have_attribute("data-resting", "true")
    source.pressed.set()
    expect(image).to_have_attribute("data-resting", "false")
    source.pressed.clear()
    expect(image).to_have_attribute("data-resting", "true")


def test_axes_hold_from_stroke_to_stroke_and_only_ever_widen(viewer, open_page):
    # the last widens the axis by so little that its round upper end stays, be it at 7 or at 8 kPa
    bumps = [Bump(base_kPa=4.0), Bump(base_kPa=4.2, amp_kPa=0.5), Bump(base_kPa=2.5, amp_kPa=0.5)]
    source = SyntheticSource(bumps, seconds=0.4, rest=0.0, limit=1)
    page = open_page(viewer(source))
    expect(page.locator("#stroke-1")).to_be_visible()
    expect(page.locator("#map")).not_to_have_attribute("data-y", "0 8")  # as it is before a stroke's map
    settled(page)
    before = page.locator("#map").get_attribute("data-y")
    source.limit = 2
    expect(page.locator("#estimate-which")).to_contain_text("stroke 2,")
    settled(page)
    assert before and page.locator("#map").get_attribute("data-y") == before
    source.limit = 3
    expect(page.locator("#estimate-which")).to_contain_text("stroke 3,")
    settled(page)
    low, high = before.split()
    now_low, now_high = (page.locator("#map").get_attribute("data-y") or "").split()
    assert float(now_low) < float(low) and now_high == high
