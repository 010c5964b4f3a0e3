"""The charts of a stroke under the pointer, and what a phone brings into sight."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from tests.host.view.pages import LUMP, once
from tests.host.view.waiting import settled

pytestmark = pytest.mark.browser


def test_one_cursor_tells_the_values_of_all_charts_and_zoom_is_shared(viewer, open_page):
    page = open_page(viewer(once(LUMP)))
    page.locator("#stroke-1").click()
    expect(page.locator("#scrub")).to_be_visible()
    charts = [page.locator(f"#{name}") for name in ("map", "displacement", "force")]
    whole = charts[0].get_attribute("data-x")
    page.locator("#displacement").hover(position={"x": 100, "y": 40})
    for chart, unit in zip(charts, ("kPa", "mm", "N/m")):
        expect(chart).to_have_attribute("data-read", re.compile(rf"^[\u2212\d.]+ mm: [\d.]+ {unit}$"))
    page.keyboard.press("+")
    expect(charts[0]).not_to_have_attribute("data-x", whole)
    settled(page)
    assert len({chart.get_attribute("data-x") for chart in charts}) == 1
    page.keyboard.press("0")
    expect(charts[0]).to_have_attribute("data-x", whole)


def test_the_dip_over_a_lump_fills_half_of_its_axis(viewer, open_page):
    """The press of 2.5 mm flattened it."""
    page = open_page(viewer(once(LUMP)))
    page.locator("#stroke-1").click()
    expect(page.locator("#scrub")).to_be_visible()
    settled(page)
    low, high = map(float, page.locator("#displacement").get_attribute("data-y").split())
    assert high - low <= 1.0  # the dip is .5


def test_on_a_phone_the_map_and_a_picked_stroke_come_into_sight_and_notices_cover_no_number(
    viewer, open_page
):
    page = open_page(viewer(once(LUMP, LUMP)), 390, 844)
    expect(page.locator("#stroke-2")).to_be_visible()
    expect(page.locator("#visit-answer")).to_contain_text("2 strokes over one lump")

    def top(selector):
        return page.locator(selector).bounding_box()["y"]

    page.locator("#stroke-1").click()
    expect(page.locator("#scrub")).to_be_visible()
    settled(page)
    assert 0 < top("#image") < 844 / 2
    page.set_viewport_size({"width": 360, "height": 740})
    settled(page)
    said = page.locator("#image").get_attribute("data-said")
    assert "width not known" in said and not said.endswith(",")  # what had no room left its comma behind
    page.set_viewport_size({"width": 390, "height": 844})
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    page.locator("#visit-map-button").click()
    settled(page)
    assert 0 < top("#visit-map") < 844 / 2
    page.keyboard.press("v")
    page.keyboard.press("Enter")
    note = page.locator("#toasts p").first.bounding_box()
    assert note["y"] + note["height"] <= page.locator(".bar").bounding_box()["height"]
