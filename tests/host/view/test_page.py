"""The page in a real browser, fed with made-up strokes whose answers are known."""

from __future__ import annotations

import csv
import io
import re

import pytest
from playwright.sync_api import expect

from palpate.stroke.answered import Answered
from tests.host.view.pages import LUMP, new_visit, once
from tests.host.view.synthetic import IN_GLAND, Bump, SyntheticSource
from tests.host.view.waiting import eventually, noticed, recording_begun, recording_ended

pytestmark = pytest.mark.browser


def rows(page):
    """The card's numbers by their key."""
    return {
        node.get_attribute("data-key"): node.inner_text() for node in page.locator("#card [data-key]").all()
    }


def test_the_card_says_diameter_depth_stiffness_thickness_and_force_with_intervals(viewer, open_page):
    page = open_page(viewer(once(LUMP)))
    expect(page.locator("#card .verdict")).to_have_text("Lump found")
    shown = rows(page)
    assert list(shown) == ["d_mm", "depth_mm", "stiffness", "t_mm", "F_N_per_m"]
    assert re.search(r"10\.0\s+mm\s+9\.3 to 10\.7", shown["d_mm"])
    assert "8.0 mm" in shown["depth_mm"] and "13.0 mm" in shown["t_mm"] and "100 N/m" in shown["F_N_per_m"]
    assert "hard" in shown["stiffness"]
    foot = page.locator("#card .foot")
    expect(foot).to_contain_text("90 times in 100")
    expect(foot).to_contain_text("Model 0011223344556677")
    expect(foot).to_contain_text("Research use, not a diagnosis.")


@pytest.mark.parametrize(
    ("kind", "title", "numbers"),
    [
        ("none", "No lump found", []),
        ("outside", "Outside what the model knows", ["d_mm", "depth_mm", "stiffness", "t_mm", "F_N_per_m"]),
        ("force", "Force too low", ["F_N_per_m"]),
        ("unread", "Stroke could not be read", ["F_N_per_m"]),
    ],
)
def test_what_the_probe_cannot_vouch_for_is_said_in_plain_words(viewer, open_page, kind, title, numbers):
    page = open_page(viewer(once(Bump(kind=kind))))
    expect(page.locator("#card .verdict")).to_have_text(title)
    expect(page.locator("#card .say")).to_have_text(re.compile(r"\.$"))
    assert list(rows(page)) == numbers


def test_a_lump_of_unbounded_stiffness_gets_a_bound_and_no_number(viewer, open_page):
    page = open_page(viewer(once(Bump(E_inv23=0.05))))
    expect(page.locator('[data-key="stiffness"]')).to_contain_text("over 14 × fat")


def test_where_a_lump_lies_is_said_after_its_depth_with_which_size_goes_with_which_stiffness(
    viewer, open_page
):
    page = open_page(viewer(once(Bump(layer=IN_GLAND))))
    expect(page.locator('#card [data-key="layer"]')).to_contain_text("in the gland (90 %)")
    shown = rows(page)
    assert list(shown) == ["d_mm", "depth_mm", "layer", "stiffness", "t_mm", "F_N_per_m"]
    assert "Diameter 13.4 mm if 3.1 × fat, 10.1 mm if over 50 × fat (each ± 7 %)" in shown["layer"]
    assert "15.0 mm" in shown["depth_mm"]


def test_the_map_grows_during_a_stroke_and_gets_its_fit(viewer, open_page):
    source = SyntheticSource([LUMP], seconds=0.8, limit=1)
    source.halt_mm = 0.0
    page = open_page(viewer(source))
    expect(page.locator("#map-legend")).to_contain_text("no bump to fit yet")
    expect(page.locator('[data-step="lump"]')).to_have_class("on")
    source.halt_mm = 20.0
    expect(page.locator("#map-legend")).to_contain_text("fit by the viewer")
    source.halt_mm = None
    expect(page.locator("#map-legend")).to_contain_text("fit by the probe")
    expect(page.locator("#map-legend")).to_contain_text("Stdev 4.6 mm")


def test_an_earlier_stroke_is_shown_again_and_escape_goes_back(viewer, open_page):
    page = open_page(viewer(once(LUMP, Bump(d_mm=20.0))))
    expect(page.locator("#stroke-2")).to_be_visible()
    page.locator("#stroke-1").click()
    expect(page.locator("#estimate-which")).to_contain_text("stroke 1,")
    expect(page.locator("#stroke-1")).to_have_attribute("aria-selected", "true")
    expect(page.locator('[data-key="d_mm"]')).to_contain_text("10.0")
    note = page.locator("#scrub-text")
    expect(page.locator("#image-note")).to_have_text("stroke 1")
    first = note.inner_text()
    page.locator("#scrub-range").focus()
    page.keyboard.press("Home")
    expect(note).not_to_have_text(first)
    page.locator("#strokes").focus()
    page.keyboard.press("ArrowUp")
    expect(page.locator("#estimate-which")).to_contain_text("stroke 2,")
    expect(page.locator('[data-key="d_mm"]')).to_contain_text("20.0")
    page.keyboard.press("Escape")
    expect(page.locator("#back-live")).to_be_hidden()
    expect(page.locator("#stroke-2")).to_have_attribute("aria-selected", "false")


def test_repeatability_counts_what_the_cards_vouch_for_only(viewer, open_page):
    bumps = [Bump(d_mm=9.8), Bump(d_mm=10.2), Bump(kind="none"), Bump(kind="outside", d_mm=50.0)]
    page = open_page(viewer(once(*bumps)))
    expect(page.locator("#stroke-4")).to_be_visible()
    expect(page.locator("#repeat-text")).to_contain_text("10.0 mm, spread (sd) 0.")
    expect(page.locator("#repeat-text")).to_contain_text("95 times in 100")
    page.locator("#quantity").select_option("F_N_per_m")
    expect(page.locator("#repeat-text")).to_contain_text("100 N/m")


def test_growth_between_two_visits_is_told_from_chance(viewer, open_page):
    source = once(Bump(d_mm=10.0), Bump(d_mm=10.3), Bump(d_mm=10.0), Bump(d_mm=10.3))
    page = open_page(viewer(source))
    expect(page.locator("#stroke-4")).to_be_visible()
    new_visit(page, "in spring")
    expect(page.locator("#visit-b option:checked")).to_have_text("in spring")
    source.bumps = [Bump(d_mm=13.0), Bump(d_mm=13.2)]
    source.limit = 8
    expect(page.locator("#stroke-8")).to_be_visible()
    expect(page.locator("#comparison .result")).to_contain_text("beyond repeatability")
    expect(page.locator("#comparison .result")).to_contain_text(re.compile(r"grew by [23]\.\d mm"))


def test_record_and_mark_from_the_keyboard(viewer, open_page, tmp_path):
    source = SyntheticSource([LUMP], seconds=0.5)
    page = open_page(viewer(source))
    expect(page.locator("#link-text")).to_have_text("Connected")
    page.keyboard.press("m")
    noticed(page, "Press R to record")
    recording_begun(page)
    page.keyboard.press("m")
    page.locator("#text-value").fill("left side")
    page.keyboard.press("Enter")
    expect(page.locator("#dialog-text")).to_be_hidden()
    recording_ended(page)
    assert source.marks == ["left side"]
    (file,) = source.recorded
    assert file.suffix == ".mcap" and file.parent == tmp_path / "recordings"


def test_keys_right_after_a_dialog_and_in_quick_succession_are_heard(viewer, open_page):
    """A page too busy to draw: the closed dialog still has the focus, and answers come late."""
    source = SyntheticSource([LUMP], seconds=0.5)
    page = open_page(viewer(source))
    expect(page.locator("#link-text")).to_have_text("Connected")
    page.evaluate(
        "() => setInterval(() => { const t = performance.now(); while (performance.now() - t < 150); }, 160)"
    )
    for _ in range(5):
        page.keyboard.press("r")
    page.keyboard.press("m")
    page.keyboard.type("here")
    page.keyboard.press("Enter")
    page.keyboard.press("r")
    wanted = ["start", "stop", "start", "stop", "start", "mark here", "stop"]
    eventually(lambda: source.told == wanted, lambda: source.told)
    expect(page.locator("#record-text")).to_have_text("Record")


def test_pictures_and_tables_can_be_taken_away(viewer, open_page):
    page = open_page(viewer(once(LUMP)))
    expect(page.locator("#export-png")).to_have_attribute("href", "/api/stroke-1.png")
    wanted = {
        "Stroke as PNG picture": b"\x89PNG",
        "Stroke as SVG picture": b"<?xml",
        "Stroke's traces as CSV": b"position_mm,displacement_mm,force_N_per_m",
        "Stroke with its images as JSON": b"{",
        "Tactile image on screen as PNG": b"\x89PNG",
        "Table of all strokes as CSV": b"stroke,visit,utc,verdict,d_mm",
    }
    for words, start in wanted.items():
        page.keyboard.press("e")
        with page.expect_download() as download:
            page.get_by_text(words).click()
        data = download.value.path().read_bytes()
        assert data.startswith(start), words
    line = next(csv.DictReader(io.StringIO(data.decode())))
    assert float(line["d_mm"]) == 10.0 and line["notice"] == "Research use, not a diagnosis."


def test_two_visits_say_what_their_comparison_takes_for_granted(viewer, open_page):
    source = once(Bump(d_mm=10.0), Bump(d_mm=10.3))
    page = open_page(viewer(source))
    expect(page.locator("#stroke-2")).to_be_visible()
    page.keyboard.press("v")
    page.keyboard.press("Enter")
    source.limit = 4
    expect(page.locator("#comparison")).to_contain_text("zero or gain")
    page.locator("#comparison summary").click()
    source.limit = 5
    expect(page.locator("#stroke-5")).to_be_visible()
    expect(page.get_by_text("zero or gain")).to_be_visible()  # and is not shut in its reader's face


def test_after_the_first_stroke_its_answer_is_awaited(viewer, open_page):
    """Until it came the card said that there was no stroke yet, to a page opened meanwhile as well."""
    held = []

    def held_back(emit, _):
        def without_answers(event):
            if isinstance(event, Answered):
                held.append(lambda: emit(event))
            else:
                emit(event)

        return without_answers

    shown = viewer(once(LUMP), beside=held_back)
    first = open_page(shown)
    expect(first.locator("#card")).to_contain_text("Its answer is on its way.")
    second = open_page(shown)
    expect(second.locator("#card")).to_contain_text("Its answer is on its way.")
    held[0]()
    for page in (first, second):
        expect(page.locator("#card .verdict")).to_have_text("Lump found")
