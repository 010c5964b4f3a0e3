"""The page in a real browser, fed with made-up strokes whose answers are known."""

from __future__ import annotations

import csv
import io
import re

import pytest
from playwright.sync_api import expect

from palpate.view.page_connection import MAX_UNDRAWN
from tests.host.view.chromium import free_port
from tests.host.view.synthetic import Bump, SyntheticSource
from tests.host.view.waiting import eventually, noticed, recording_begun, settled

pytestmark = pytest.mark.browser

LUMP = Bump(d_mm=10.0, h=0.8)


def once(*bumps: Bump) -> SyntheticSource:
    """One stroke over each, and then a page where nothing moves any more."""
    return SyntheticSource(list(bumps), seconds=0.4, rest=0.0, limit=len(bumps))


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
        ("none", "No lump found", ["F_N_per_m"]),
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
    page.keyboard.press("v")
    page.locator("#text-value").fill("in spring")
    page.keyboard.press("Enter")
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
    page.keyboard.press("r")
    expect(page.locator("#record-text")).to_have_text("Record")
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


def test_it_says_when_the_probe_is_gone_and_goes_on_by_itself(viewer, open_page):
    source = SyntheticSource([LUMP], seconds=0.6)
    page = open_page(viewer(source))
    expect(page.locator("#stroke-1")).to_be_visible()
    source.plugged.clear()
    expect(page.locator("#banner")).to_contain_text("The probe is gone")
    expect(page.locator("#link-text")).to_have_text("Probe gone")
    seen = page.locator("#strokes [data-number]").count()  # what was told before has been told in full
    source.plugged.set()
    expect(page.locator("#banner")).to_be_hidden()
    expect(page.locator(f"#stroke-{seen + 1}")).to_be_visible()


def test_the_page_outlives_the_viewer_program(viewer, open_page):
    port = free_port()
    first = viewer(SyntheticSource([LUMP], seconds=0.5), port=port)
    page = open_page(first)
    expect(page.locator("#stroke-1")).to_be_visible()
    first.__exit__()
    expect(page.locator("#link-text")).to_have_text("Viewer stopped")
    viewer(SyntheticSource([Bump(d_mm=20.0)], seconds=0.5), port=port, token=first.token)
    expect(page.locator("#link-text")).to_have_text("Connected")
    expect(page.locator('[data-key="d_mm"]')).to_contain_text("20.0")


@pytest.mark.parametrize(
    ("name", "width", "height", "scheme"),
    [
        ("desk", 1280, 800, "dark"),
        ("desk", 1280, 800, "light"),
        ("phone", 390, 844, "dark"),
        ("phone", 390, 844, "light"),
    ],
)
def test_everything_fits_the_window(viewer, open_page, name, width, height, scheme):
    page = open_page(viewer(once(LUMP)), width, height, scheme)
    expect(page.locator("#stroke-1")).to_be_visible()
    expect(page.locator("#card .verdict")).to_be_visible()
    settled(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    if name == "desk":
        page.locator("#stroke-1").click()
        expect(page.locator("#image-note")).to_have_text("stroke 1")
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


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_text_can_be_read_against_its_ground(viewer, open_page, scheme):
    """WCAG 2 AA: contrast of 4.5 for all text on the page."""
    page = open_page(viewer(once(LUMP)), scheme=scheme)
    expect(page.locator("#card .verdict")).to_be_visible()
    settled(page)
    poor = page.evaluate(
        """() => {
          const parse = (text) => (text.match(/[\\d.]+/g) ?? [0, 0, 0, 0]).map(Number);
          const light = ([r, g, b]) => [r, g, b].map((v) => v / 255)
            .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
            .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
          const ground = (node) => {
            for (; node; node = node.parentElement) {
              const c = parse(getComputedStyle(node).backgroundColor);
              if (c.length < 4 || c[3] > 0.9) return c;
            }
            return [255, 255, 255];
          };
          const poor = [];
          for (const node of document.querySelectorAll("body *")) {
            const text = [...node.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
            if (!text || !node.offsetParent || node.closest("[aria-disabled=true], option")) continue;
            const [a, b] = [light(parse(getComputedStyle(node).color)), light(ground(node))].sort((x, y) =>
            y - x); const ratio = (a + 0.05) / (b + 0.05);
            if (ratio < 4.5) poor.push(`${node.tagName} ${node.className} ${node.textContent.trim().slice(0,
            20)} ${ratio.toFixed(2)}`);
          }
          return poor;
        }"""
    )
    assert poor == []


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
    assert {"record", "mark", "new-visit", "theme", "help", "scale", "colors", "strokes", "quantity", "last",
            "visit-a", "visit-b", "load-visit"} <= reached  # fmt: skip


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
    page.keyboard.press("v")
    page.locator("#text-value").fill("<img src=x onerror=document.title='owned'>")
    page.keyboard.press("Enter")
    expect(page.locator("#visit-b option:checked")).to_have_text("<img src=x onerror=document.title='owned'>")
    assert page.title() != "owned"


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


def test_a_colour_means_one_pressure_for_a_whole_visit(viewer, open_page):
    """The automatic scale hopped within a stroke, so that 4.7 kPa was yellow and the lump's 5.4 kPa green."""
    high, low = Bump(base_kPa=4.0, amp_kPa=1.5), Bump(base_kPa=1.0, amp_kPa=0.3)
    source = SyntheticSource([high, low, low], seconds=0.4, rest=0.0, limit=1)
    page = open_page(viewer(source))
    expect(page.locator("#stroke-1")).to_be_visible()
    expect(page.locator("#image")).to_have_attribute("data-top-kpa", "7.5")
    source.limit = 3
    expect(page.locator("#stroke-3")).to_be_visible()
    settled(page)
    expect(page.locator("#image")).to_have_attribute("data-top-kpa", "7.5")
    page.keyboard.press("v")
    page.keyboard.press("Enter")
    expect(page.locator("#image")).to_have_attribute("data-top-kpa", "5")


def test_axes_hold_from_stroke_to_stroke_and_only_ever_widen(viewer, open_page):
    bumps = [Bump(base_kPa=4.0), Bump(base_kPa=4.2, amp_kPa=0.5), Bump(base_kPa=2.0, amp_kPa=0.5)]
    source = SyntheticSource(bumps, seconds=0.4, rest=0.0, limit=1)
    page = open_page(viewer(source))
    expect(page.locator("#stroke-1")).to_be_visible()
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


def test_escape_closes_the_menu_wherever_the_focus_is_and_e_keeps_it_visible(viewer, open_page):
    page = open_page(viewer(once(LUMP)))
    expect(page.locator("#stroke-1")).to_be_visible()
    page.keyboard.press("e")
    assert page.evaluate("document.activeElement.matches('#export summary:focus-visible')")
    for place in ("#scale", "#last", "#export-csv", "#strokes"):
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


def test_two_visits_are_compared_without_scrolling_at_1280_by_800(viewer, open_page):
    """Two rows of four were below the edge."""
    source = once(Bump(d_mm=10.0), Bump(d_mm=10.3))
    page = open_page(viewer(source, fat_kPa=10.0))
    expect(page.locator("#stroke-2")).to_be_visible()
    page.keyboard.press("v")
    page.keyboard.press("Enter")
    expect(page.locator("#visit-b option")).to_have_count(2)
    source.bumps, source.limit = [Bump(d_mm=13.0), Bump(d_mm=13.2)], 4
    expect(page.locator("#stroke-4")).to_be_visible()
    expect(page.locator("#comparison .result")).to_contain_text("beyond repeatability")
    expect(page.locator("#comparison tbody tr")).to_have_count(4)
    assert (
        page.evaluate("(box => box.scrollHeight - box.clientHeight)(document.querySelector('#comparison'))")
        <= 1
    )
