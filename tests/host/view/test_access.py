"""The page and the report for those who use a keyboard, a screen reader, or little contrast and motion.

The rules are axe-core's: WCAG 2.2 A and AA, and its good practice.
"""

from __future__ import annotations

import pytest
from axe_playwright_python.sync_playwright import Axe
from matplotlib.figure import Figure
from playwright.sync_api import expect

from palpate.report import write_report
from palpate.report.items import Summary
from tests.host.view.synthetic import Bump, SyntheticSource
from tests.host.view.waiting import PATIENCE_S, recording_begun, settled

pytestmark = pytest.mark.browser

DESK, PHONE = (1280, 800), (390, 844)


def complaints(page) -> list[str]:
    """What axe-core finds wrong: rule, and the first element that breaks it."""
    found = Axe().run(page).response["violations"]
    return [f"{rule['id']}: {rule['nodes'][0]['html'][:120]}" for rule in found]


@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_axe_finds_nothing_wrong_live_picked_gone_or_with_a_dialog_open(viewer, open_page, scheme, size):
    bumps = [Bump(), Bump(kind="outside"), Bump(kind="none")]
    source = SyntheticSource(bumps, seconds=0.3, rest=0.0, limit=len(bumps))
    page = open_page(viewer(source), *size, scheme)
    expect(page.locator("#card .verdict")).to_have_text("No lump found")
    settled(page)
    assert complaints(page) == []
    page.locator("#stroke-2").click()
    expect(page.locator("#card .verdict")).to_have_text("Outside what the model knows")
    assert complaints(page) == []
    page.keyboard.press("Escape")
    page.keyboard.press("?")
    expect(page.locator("#dialog-help")).to_be_visible()
    assert complaints(page) == []
    page.keyboard.press("Escape")
    page.keyboard.press("l")
    expect(page.locator("#visit-map")).to_have_attribute("data-strips", "1 2 3")
    assert complaints(page) == []
    page.locator("#export summary").click()
    source.plugged.clear()
    expect(page.locator("#banner")).to_be_visible()
    assert complaints(page) == []


def test_the_focus_can_be_seen_on_every_control(viewer, open_page):
    page = open_page(viewer(SyntheticSource([Bump()], seconds=0.4, limit=1)))
    expect(page.locator("#stroke-1")).to_be_visible()
    unseen = set()
    for _ in range(25):
        page.keyboard.press("Tab")
        unseen.add(
            page.evaluate(
                """(() => { const e = document.activeElement; const s = getComputedStyle(e);
                return e === document.body || (s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) >= 1)
                  ? '' : e.id || e.outerHTML.slice(0, 80); })()"""
            )
        )
    assert unseen == {""}


def test_nothing_moves_by_itself_for_who_wants_less_motion(viewer, open_page):
    page = open_page(viewer(SyntheticSource([Bump()], seconds=0.5)))
    recording_begun(page)
    # The red dot breathes, else this test could not fail.
    page.wait_for_function("() => document.getAnimations().length > 0")
    page.emulate_media(reduced_motion="reduce")
    page.wait_for_function("() => document.getAnimations().length === 0")


def test_the_report_can_be_read_by_everybody(browser, tmp_path):
    path = write_report(tmp_path / "report", simulate=False)
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(1000 * PATIENCE_S)
    page.goto(path.as_uri())
    assert complaints(page) == []
    page.close()


def test_on_a_phone_a_report_s_stroke_is_as_wide_as_the_window(browser, tmp_path):
    """The picture made for a desk had to be moved sideways."""
    wide, narrow = tmp_path / "wide.png", tmp_path / "narrow.png"
    for path, size in ((wide, (11.5, 5.9)), (narrow, (3.7, 13.5))):
        Figure(figsize=size).savefig(path)
    rows = [("diameter d, mm", "11.9", "11.6 to 12.3", "12")]
    summary = Summary(
        "A lump of 11.9 mm", "One stroke.", "The stroke", "probe", rows, wide, narrow, "90 % interval"
    )
    report = write_report(tmp_path / "report", simulate=False, summary=summary)
    page = browser.new_page(viewport={"width": 360, "height": 740})
    page.set_default_timeout(1000 * PATIENCE_S)
    page.goto(report.as_uri())
    page.wait_for_function("(i => i.naturalWidth < i.naturalHeight)(document.querySelector('#stroke img'))")
    assert page.evaluate("document.documentElement.scrollWidth") == 360
    assert page.evaluate(
        "[...document.querySelectorAll('#stroke *')].filter(e => e.scrollWidth > e.clientWidth + 1"
        " && getComputedStyle(e).overflowX !== 'visible').map(e => e.outerHTML.slice(0, 80))"
    ) == []  # fmt: skip
    assert complaints(page) == []
    page.set_viewport_size({"width": 1280, "height": 800})
    page.wait_for_function("(i => i.naturalWidth > i.naturalHeight)(document.querySelector('#stroke img'))")
