"""Every layout of the page, whatever the font and the size of the text: nothing is cut, covered or outside.

The page carries its own font. Here it is also given one of the narrowest text faces of Debian in its place
(PT Sans Narrow, of fonts-paratype) and the widest (DejaVu Sans, the only one of a fresh installation).
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import pytest
from playwright.sync_api import expect

from palpate.view import app
from tests.host.view.pages import new_visit
from tests.host.view.synthetic import Bump, SyntheticSource
from tests.host.view.waiting import PATIENCE_S, settled

pytestmark = pytest.mark.browser

SIZES = ((360, 740), (390, 844), (768, 1024), (1024, 768), (1280, 800), (1920, 1080))
NPM = Path(app.__file__).parent / "fonts" / "node_modules"
FONTS = {
    "own": None,
    "narrow": NPM / "@fontsource" / "pt-sans-narrow" / "files" / "pt-sans-narrow-latin-400-normal.woff2",
    "wide": Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf",
}
USUAL_PX = 16

WRONG = (Path(__file__).parent / "layout.js").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def roomy_browser(launch):
    """A browser whose reader has set its text to 125 %."""
    return launch(f"--blink-settings=defaultFontSize={USUAL_PX * 5 // 4}")


def test_the_page_carries_its_own_font():
    assert app.page_files()["text.woff2"].startswith(b"wOF2"), "no font; run: .ci/setup"


@pytest.mark.parametrize("text", [100, 125])
@pytest.mark.parametrize("font", FONTS)
def test_nothing_is_cut_at_any_width_in_any_font(viewer, browser, request, font, text):
    bumps = [Bump(d_mm=10.0), Bump(d_mm=10.3), Bump(d_mm=10.1, hardness="unsure", E_inv23=0.2)]
    source = SyntheticSource(bumps, seconds=0.3, rest=0.0, limit=len(bumps))
    shown = viewer(source, fat_kPa=10.0)
    opened = browser if text == 100 else request.getfixturevalue("roomy_browser")
    page = opened.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(1000 * PATIENCE_S)
    if (file := FONTS[font]) is not None:
        page.route("**/static/text.woff2", lambda route: route.fulfill(body=file.read_bytes()))
    page.goto(shown.url)
    expect(page.locator("#stroke-3")).to_be_visible()
    assert page.evaluate("document.fonts.ready.then(() => document.fonts.check('14px \"Inter Variable\"'))")
    assert (
        page.evaluate("parseFloat(getComputedStyle(document.documentElement).fontSize)")
        == USUAL_PX * text / 100
    )
    complaints = look_at_all_widths(page, "a lump, unsure")
    page.locator("#export summary").click()
    complaints += look_at_all_widths(page, "the menu")
    page.keyboard.press("Escape")
    new_visit(page, "After six months, and a holiday in between")
    expect(page.locator("#visit-b option")).to_have_count(2)
    source.bumps, source.limit = [Bump(d_mm=13.0), Bump(d_mm=13.2), Bump(kind="outside", d_mm=23.0)], 6
    expect(page.locator("#stroke-6")).to_be_visible()
    expect(page.locator("#comparison table")).to_be_visible()
    page.locator("#stroke-6").click()
    expect(page.locator("#scrub")).to_be_visible()
    complaints += look_at_all_widths(page, "picked, compared")
    page.keyboard.press("l")
    expect(page.locator("#visit-map")).to_have_attribute("data-strips", "4 5 6")
    complaints += look_at_all_widths(page, "the map of the visit")
    page.keyboard.press("l")
    source.plugged.clear()
    expect(page.locator("#banner")).to_be_visible()
    page.keyboard.press("?")
    complaints += look_at_all_widths(page, "gone, help")
    page.close()
    assert complaints == [], "\n".join(complaints)


def look_at_all_widths(page, state):
    """What is wrong in this state of the page, with the width at which it is."""
    found = []
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        settled(page)
        found += [f"{state}, {width}: {what}" for what in page.evaluate(WRONG)]
    return found
