"""Visits and whole viewers that come and go in any order: what the reader asked for last is shown.

Answers are held back where they would else come too soon to matter; nothing here waits for a time.
"""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.host.view.chromium import free_port
from tests.host.view.pages import LUMP, new_visit, opened, told
from tests.host.view.synthetic import Bump, SyntheticSource
from tests.host.view.waiting import eventually, held, noticed

pytestmark = pytest.mark.browser


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
    new_visit(page, "in spring")
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
    expect(page.locator("#link-text")).to_have_text("Connected")
    expect(page.locator("#card")).to_contain_text("No stroke yet.")
    expect(page.locator("#strokes")).to_contain_text("Strokes are listed here as they end.")
    expect(page.locator("#back-live")).to_be_hidden()
    expect(page.locator("#export-png")).not_to_have_attribute("href", "/api/stroke-1.png")
    source.limit = 1
    expect(page.locator('[data-key="d_mm"]')).to_contain_text("15.0")
