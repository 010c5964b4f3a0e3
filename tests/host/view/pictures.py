"""Pictures of the viewer and the report for the docs: python -m tests.host.view.pictures DEMO_DIRECTORY.

DEMO_DIRECTORY is what `palpate demo --out` wrote: its key, model image and report are used. The probe is
emulated; its firmware, model, link and noise are real. The map of a visit is of solid lumps; they are kept
with the tests.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Browser, Page, expect, sync_playwright

from palpate.link.flash import flash
from palpate.link.probe import Probe
from palpate.sim.probe.emulated import EmulatedProbe
from palpate.sim.probe.over_lump import strokes_over
from palpate.stroke.read import load_strokes
from palpate.view.live import LiveSource
from palpate.view.replay import ReplaySource
from palpate.view.serve import Viewer
from tests.host.view import balls
from tests.host.view.chromium import CHROMIUM_OPTIONS, chromium
from tests.host.view.pages import new_visit, pick
from tests.host.view.waiting import recording_ended, settled

PICTURES = Path(__file__).parents[3] / "docs" / "pictures"
FIRST, SECOND = "d12h06e20f07_ball", "d15h05e20f06_ball"
STROKES, FRAMES = 5, 150


def main(demo: Path) -> None:
    """Take all pictures."""
    expect.set_options(timeout=120_000)
    before, calibration = strokes_over(FIRST, "typical", 5, FRAMES, STROKES, steady=True, press=True)
    after, _ = strokes_over(SECOND, "typical", 5, FRAMES, STROKES, steady=True, press=True)
    key = (demo / "key" / "public.key").read_bytes()
    with (
        tempfile.TemporaryDirectory() as folder,
        EmulatedProbe(
            strokes=[*before, *after], public_key=key, repeat=True, calibration=calibration, roomy=True
        ) as probe,
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=chromium(), args=CHROMIUM_OPTIONS) as browser,
    ):
        with Probe.open(probe.port) as client:
            flash(client, (demo / "model.palp").read_bytes())
        recordings = Path(folder)
        with Viewer(LiveSource(probe.port), mode="live", recordings=recordings) as viewer:
            _live(_open(browser, viewer), _open(browser, viewer, 390, 844), viewer)
        (recording,) = recordings.glob("*.mcap")
        source = ReplaySource(recording)
        with Viewer(source, mode="replay", recordings=recordings, load_strokes=load_strokes) as viewer:
            _replay(_open(browser, viewer, scheme="light"))
        _lanes(browser, key, (demo / "model.palp").read_bytes())
        _report(browser, demo / "report" / "index.html")


def _lanes(browser: Browser, key: bytes, image: bytes) -> None:
    """One lump beside the line, stroked from both sides, and another farther on."""
    aside, beyond = balls.clear_beside(), balls.clear_on_line()
    strokes = [balls.felt(aside, FRAMES), balls.felt(aside, FRAMES, turned=True), balls.felt(beyond, FRAMES)]
    calibration = balls.calibration()
    step_mm = round(2 * aside.case.offset_mm)
    with (
        tempfile.TemporaryDirectory() as folder,
        EmulatedProbe(
            strokes=strokes, public_key=key, model=image, calibration=calibration, roomy=True
        ) as probe,
    ):
        viewer = Viewer(LiveSource(probe.port), mode="live", recordings=Path(folder))
        viewer.session.set_lanes(True, 0.0, step_mm)
        with viewer:
            page = _open(browser, viewer)
            expect(page.locator("#stroke-3")).to_be_visible()
            page.keyboard.press("l")
            pick(page, 2)
            expect(page.locator("#visit-map")).to_have_attribute("data-strips", "1 2 3")
            settled(page)
            page.mouse.move(1, 1)
            page.screenshot(path=PICTURES / "viewer-map.png")
            page.close()


def _open(
    browser: Browser, viewer: Viewer, width: int = 1280, height: int = 800, scheme: str = "dark"
) -> Page:
    page = browser.new_page(
        viewport={"width": width, "height": height},
        color_scheme=scheme,
        device_scale_factor=2 if width < 600 else 1,
    )  # type: ignore[arg-type]
    page.goto(viewer.url)
    return page


def _live(page: Page, phone: Page, viewer: Viewer) -> None:
    page.keyboard.press("r")
    expect(page.locator(f"#stroke-{STROKES - 1}")).to_be_visible()
    page.wait_for_selector("[data-step=stroke].on")
    new_visit(page, "After six months")  # the fifth stroke has begun and still belongs to the first
    expect(page.locator(f"#stroke-{2 * STROKES - 1}")).to_be_visible()
    _in_mid_stroke(page)
    page.screenshot(path=PICTURES / "viewer.png")
    phone.screenshot(path=PICTURES / "viewer-phone.png")
    expect(page.locator(f"#stroke-{2 * STROKES}")).to_be_visible()
    recording_ended(page)


def _in_mid_stroke(page: Page) -> None:
    """Wait until the probe is past the lump and the map has its fit."""
    page.wait_for_function(
        "() => document.querySelector('[data-step=lump]').className === 'on' && "
        "document.getElementById('map-legend').textContent.includes('fit by the viewer') && "
        "Number(document.getElementById('now-position').textContent) > 18",
        polling="raf",
    )


def _replay(page: Page) -> None:
    expect(page.locator("#ticks .stroke").nth(3)).to_be_attached()
    page.keyboard.press("Space")
    page.locator("#stroke-2").click()
    expect(page.locator("#scrub")).to_be_visible()
    expect(page.locator("#estimate-which")).to_contain_text("stroke 2,")
    page.mouse.move(1, 1)
    page.wait_for_timeout(500)
    page.screenshot(path=PICTURES / "viewer-replay.png")


def _report(browser: Browser, path: Path) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.goto(path.resolve().as_uri())
    page.wait_for_timeout(1500)
    page.screenshot(path=PICTURES / "report.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
