"""Everybody can use the page: any window, contrast, keyboard, screen reader, theme; words stay words."""

from __future__ import annotations

from dataclasses import replace

import pytest
from playwright.sync_api import expect

from tests.host.view.pages import LUMP, new_visit, once, pick
from tests.host.view.synthetic import IN_GLAND, Bump
from tests.host.view.waiting import settled

pytestmark = pytest.mark.browser


@pytest.mark.parametrize(("name", "width", "height"), [("desk", 1280, 800), ("phone", 390, 844)])
def test_everything_fits_the_window(viewer, open_page, name, width, height):
    page = open_page(viewer(once(LUMP)), width, height)
    expect(page.locator("#stroke-1")).to_be_visible()
    expect(page.locator("#card .verdict")).to_be_visible()
    settled(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    if name == "desk":
        pick(page, 1)
        expect(page.locator("#map-legend")).to_contain_text("fit by the probe")
        settled(page)
        page.evaluate("(e => { e.innerHTML = e.innerHTML.replace('probe', 'viewer'); })"
                      "(document.querySelector('#map-legend'))")  # the longest that it can be  # fmt: skip
        assert page.evaluate("document.documentElement.scrollHeight") <= height
        cut = page.evaluate(
            "[...document.querySelectorAll('#card, .readouts, .panel-head, .bar, .health, .legend')]"
            ".filter(e => e.scrollWidth > e.clientWidth + 1).map(e => e.id || e.className)"
        )
        assert cut == []
        assert page.evaluate("(c => c.scrollHeight - c.clientHeight)(document.querySelector('#card'))") <= 1
    for canvas in ("image", "map", "displacement", "force", "repeat"):
        box = page.locator(f"canvas#{canvas}").bounding_box()
        assert box["width"] > 120 and box["height"] > 80, canvas


@pytest.mark.parametrize(
    "further",
    [{}, {"width_mm": 14.0, "place_mm": 3.0}, {"layer": IN_GLAND}],
    ids=["border", "solid", "anywhere"],
)
def test_the_comparison_of_visits_fits_below_the_longest_card(viewer, open_page, further):
    """At 1280 x 800 two of its four rows were below the edge, or its last line: when the stroke was outside
    what the model knows, and when a model told the fat, or width and place across, too."""
    fat = Bump(d_mm=10.0, E_fat_kPa=10.4, hardness="unsure", E_inv23=0.2, **further)
    source = once(fat, fat, fat)
    page = open_page(viewer(source), 1280, 800)
    expect(page.locator("#stroke-3")).to_be_visible()
    new_visit(page, "After six months")
    expect(page.locator("#visit-b option:checked")).to_have_text("After six months")
    source.bumps, source.limit = (
        [
            replace(fat, d_mm=13.0),
            replace(fat, d_mm=13.2),
            replace(fat, kind="outside", d_mm=23.0, outside=("d_mm",)),
        ],
        6,
    )
    expect(page.locator("#stroke-6")).to_be_visible()
    expect(page.locator("#card .verdict")).to_have_text("Outside what the model knows")
    expect(page.locator("#comparison .result")).to_contain_text(
        "3.1 mm"
    )  # both strokes of the visit are in it
    expect(page.locator("#comparison tbody tr")).to_have_count(4)
    settled(page)
    assert page.evaluate("(c => c.scrollHeight - c.clientHeight)(document.querySelector('#comparison'))") <= 1


def test_the_line_of_a_picked_stroke_stays_in_sight(viewer, open_page):
    """The button and the slider that come with a picked stroke took room from the list: its line was cut.
    Strokes that came later, or that were read ahead of a recording, pushed it out."""
    source = once(*[LUMP] * 8)
    page = open_page(viewer(source), 1280, 800)
    expect(page.locator("#stroke-8")).to_be_visible()
    page.locator("#stroke-1").click()
    expect(page.locator("#scrub")).to_be_visible()
    expect(page.locator("#image-note")).to_have_text("stroke 1")
    source.limit = 14
    expect(page.locator("#stroke-14")).to_be_attached()
    settled(page)
    beyond = "document.querySelector('#{}').getBoundingClientRect().bottom"
    assert page.evaluate(f"{beyond.format('stroke-1')} - {beyond.format('strokes')}") <= 1


def test_all_controls_can_be_reached_and_named_by_keyboard_and_screen_reader(viewer, open_page):
    page = open_page(viewer(once(LUMP)))
    expect(page.locator("#stroke-1")).to_be_visible()
    settled(page)
    nameless = page.evaluate(
        """[...document.querySelectorAll('button, select, input, summary, canvas')].filter((e) =>
        e.offsetParent &&
          !(e.textContent.trim() || e.ariaLabel || e.getAttribute('aria-labelledby') ||
          e.labels?.[0]?.textContent.trim())
        ).map((e) => e.id)"""
    )
    assert nameless == []
    reached = set()
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id"))
    assert {"record", "mark", "new-visit", "theme", "help", "view", "image", "strokes", "quantity", "last",
            "visit-a", "visit-b", "load-visit", "visit-map-button"} <= reached  # fmt: skip
    page.keyboard.press("l")
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id"))
    assert {"lanes-told", "lane-next", "lane-step", "visit-map-list"} <= reached


def test_the_theme_is_changed_by_key_and_remembered(viewer, open_page):
    page = open_page(viewer(once(LUMP)))
    before = page.evaluate("getComputedStyle(document.body).backgroundColor")
    page.keyboard.press("t")
    after = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert after != before
    page.reload()
    expect(page.locator("#link-text")).to_have_text("Connected")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == after


def test_words_from_outside_are_text_and_never_markup(viewer, open_page):
    page = open_page(viewer(once(LUMP)))
    expect(page.locator("#stroke-1")).to_be_visible()
    new_visit(page, "<img src=x onerror=document.title='owned'>")
    expect(page.locator("#visit-b option:checked")).to_have_text("<img src=x onerror=document.title='owned'>")
    assert page.title() != "owned"


def test_escape_closes_the_menu_wherever_the_focus_is_and_e_keeps_it_visible(viewer, open_page):
    page = open_page(viewer(once(LUMP)))
    expect(page.locator("#stroke-1")).to_be_visible()
    page.keyboard.press("e")
    assert page.evaluate("document.activeElement.matches('#export summary:focus-visible')")
    for place in ("#view", "#last", "#export-csv", "#strokes"):
        page.locator("#export").evaluate("e => { e.open = true; }")
        page.locator(place).focus()
        page.keyboard.press("Escape")
        assert page.locator("#export").evaluate("e => e.open") is False, place
        assert page.evaluate("document.activeElement.matches('#export summary')"), place


def test_what_to_type_is_set_as_code_and_not_between_backticks(viewer, open_page):
    source = once()
    page = open_page(viewer(source))
    expect(page.locator("#card")).to_contain_text("Press the probe on the tissue")
    source.gone = "No probe found. Start one with `palpate emulate d10h08e10f10`. Trying again every second."
    source.plugged.clear()
    expect(page.locator("#banner code")).to_have_text("palpate emulate d10h08e10f10")
    assert "`" not in page.locator("body").inner_text()
