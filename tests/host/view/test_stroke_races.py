"""Strokes that are picked, end and are fetched in any order: what the reader asked for last is shown."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.host.view.pages import LUMP, opened
from tests.host.view.synthetic import Bump, SyntheticSource
from tests.host.view.waiting import noticed, settled

pytestmark = pytest.mark.browser


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
