"""Strokes that are picked, end and are fetched in any order: what the reader asked for last is shown."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.host.view.pages import LUMP, opened
from tests.host.view.synthetic import Bump, SyntheticSource
from tests.host.view.waiting import noticed, settled

pytestmark = pytest.mark.browser


class Held:
    """Answers with strokes, held back from `hold` on; `waiting` has them by number.

    It stands between page and viewer from the page's beginning: put there later, it once missed requests.
    """

    def __init__(self):
        self.waiting = {}
        self.holds = False

    def watch(self, page) -> None:
        """Stand between this page and its viewer."""
        self.page = page
        page.route("**/api/stroke-*.json", self.take)

    def take(self, route) -> None:
        """Keep this request's answer, or let it pass."""
        if self.holds:
            self.waiting[int(number_of(route.request.url))] = route
        else:
            route.continue_()

    def hold(self) -> None:
        """Hold back every answer from here on."""
        self.holds = True

    def wait(self, count: int) -> dict:
        """The held answers, once there are `count` of them."""
        for _ in range(600):
            if len(self.waiting) >= count:
                return self.waiting
            self.page.wait_for_timeout(100)
        raise AssertionError(self.waiting)

    def let_go(self, number: int) -> None:
        """Let this answer arrive, and wait until it has."""
        with self.page.expect_response(f"**/api/stroke-{number}.json") as answer:
            self.waiting[number].continue_()
        answer.value.finished()


def number_of(url: str) -> str:
    return url.rpartition("stroke-")[2].removesuffix(".json")


def test_of_strokes_picked_in_quick_succession_the_last_is_shown_whatever_comes_first(viewer, open_page):
    source = SyntheticSource([LUMP, Bump(d_mm=20.0), Bump(d_mm=15.0)], seconds=0.3, rest=0.0, limit=3)
    held = Held()
    _, page = opened(viewer, open_page, source, before=held.watch)
    expect(page.locator("#stroke-3")).to_be_visible()
    held.hold()
    for _ in range(3):
        page.keyboard.press("ArrowDown")
    expect(page.locator("#stroke-1")).to_have_attribute("aria-selected", "true")
    held.wait(3)
    for number in (1, 3, 2):
        held.let_go(number)
    expect(page.locator("#estimate-which")).to_contain_text("stroke 1,")
    settled(page)
    expect(page.locator("#estimate-which")).to_contain_text("stroke 1,")
    expect(page.locator("#image-note")).to_have_text("stroke 1")


def test_escape_also_takes_back_a_stroke_that_is_still_on_its_way(viewer, open_page):
    source = SyntheticSource([LUMP, Bump(d_mm=20.0)], seconds=0.3, rest=0.0, limit=2)
    held = Held()
    _, page = opened(viewer, open_page, source, before=held.watch)
    expect(page.locator("#estimate-which")).to_contain_text("stroke 2,")
    held.hold()
    page.locator("#stroke-1").click()
    held.wait(1)
    expect(page.locator("#back-live")).to_be_visible()
    page.keyboard.press("Escape")
    held.let_go(1)
    settled(page)
    expect(page.locator("#back-live")).to_be_hidden()
    expect(page.locator("#estimate-which")).to_contain_text("stroke 2,")
    expect(page.locator("#stroke-1")).to_have_attribute("aria-selected", "false")


def test_a_stroke_that_ends_while_the_last_one_is_fetched_is_not_replaced_by_it(viewer, open_page):
    source = SyntheticSource([LUMP, Bump(d_mm=20.0)], seconds=0.3, rest=0.0, limit=1)
    held = Held()
    _, page = opened(viewer, open_page, source, before=held.watch)
    expect(page.locator("#estimate-which")).to_contain_text("stroke 1,")
    held.hold()
    page.reload()
    held.wait(1)
    source.limit = 2
    expect(page.locator("#estimate-which")).to_contain_text("stroke 2,")
    held.let_go(1)
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
