"""Every state of the page at every width, light and dark, for people to look at.

    python -m tests.host.view.states OUT_DIR RECORDING.mcap [ACT dark|light]

OUT_DIR/STATE-SCHEME-WIDTH.png. Live strokes are made up; RECORDING is played.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from playwright.sync_api import Browser, Page, expect, sync_playwright

from palpate.sim.probe.emulated import EmulatedProbe
from palpate.stroke.read import load_strokes
from palpate.view.live import LiveSource
from palpate.view.replay import ReplaySource
from palpate.view.serve import Viewer
from palpate.view.source import Source
from tests.host.view.chromium import CHROMIUM_OPTIONS, chromium
from tests.host.view.synthetic import Bump, SyntheticSource
from tests.host.view.test_layout import SIZES
from tests.host.view.waiting import PATIENCE_S, eventually, recording_begun, settled

LUMP = Bump(d_mm=12.1, h=0.71, base_kPa=3.6, amp_kPa=1.1, stdev_mm=4.2, E_inv23=0.13)
UNSURE = Bump(d_mm=11.8, h=0.69, base_kPa=3.6, amp_kPa=1.1, stdev_mm=4.2, E_inv23=0.2, hardness="unsure")
LATER = Bump(d_mm=16.4, h=0.43, base_kPa=3.4, amp_kPa=1.9, stdev_mm=4.8, E_inv23=0.12)

Shown = tuple[str, Page]


class Stage:
    """Starts viewers and opens their pages, in one scheme."""

    def __init__(self, browser: Browser, scheme: str, stack: ExitStack) -> None:
        self.browser, self.scheme, self.stack = browser, scheme, stack
        self.folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))

    def page(self, source: Source, mode: str = "live", **options) -> Page:
        self.viewer = self.stack.enter_context(
            Viewer(source, mode=mode, recordings=self.folder, fat_kPa=10.0, **options)
        )
        page = self.browser.new_page(viewport={"width": 1280, "height": 800}, color_scheme=self.scheme)  # type: ignore[arg-type]
        page.goto(self.viewer.url)
        return page


def before_the_first_stroke(stage: Stage) -> Iterator[Shown]:
    yield "before", stage.page(SyntheticSource([LUMP], limit=0))


def strokes(stage: Stage) -> Iterator[Shown]:
    source = SyntheticSource([LUMP, UNSURE], seconds=1.0, rest=0.0, limit=2)
    page = stage.page(source)
    expect(page.locator("#stroke-2")).to_be_visible()
    yield "unsure", page
    source.bumps = [LUMP]
    source.halt_mm, source.limit = 16.0, 3
    page.wait_for_function("() => Number(document.getElementById('now-position').textContent) > 15")
    recording_begun(page)
    yield "live", page
    source.halt_mm = None
    expect(page.locator("#stroke-3")).to_be_visible()
    yield "done", page
    page.keyboard.press("l")
    expect(page.locator("#visit-map")).to_have_attribute("data-strips", "1 2 3")
    yield "map-in-order", page
    page.locator("#lanes-told").check()
    eventually(lambda: stage.viewer.session.visits.lanes.told)
    source.bumps, source.limit = (
        [replace(LUMP, across_mm=11.0, columns=(17, 24)), Bump(kind="none", base_kPa=3.6)],
        5,
    )
    expect(page.locator("#stroke-5")).to_be_visible()
    expect(page.locator("#visit-map")).to_have_attribute("data-strips", "1 2 3 4 5")
    yield "map-by-lanes", page
    page.keyboard.press("l")
    page.keyboard.press("v")
    page.locator("#text-value").fill("After six months")
    page.keyboard.press("Enter")
    source.bumps, source.limit = [LATER], 8
    expect(page.locator("#stroke-8")).to_be_visible()
    expect(page.locator("#comparison table")).to_be_visible()
    yield "two-visits", page
    source.bumps, source.limit = [Bump(kind="outside", d_mm=23.0, base_kPa=3.6, amp_kPa=1.1)], 9
    expect(page.locator("#stroke-9")).to_be_visible()
    yield "outside", page
    source.bumps, source.limit = [Bump(kind="force", base_kPa=3.6, amp_kPa=1.1)], 10
    expect(page.locator("#stroke-10")).to_be_visible()
    yield "force", page
    source.plugged.clear()
    expect(page.locator("#banner")).to_be_visible()
    yield "disconnected", page


def a_long_visit(stage: Stage) -> Iterator[Shown]:
    bumps = [replace(LUMP, d_mm=12.1 + 0.1 * (k % 5), across_mm=3.0 * (k % 3)) for k in range(5)]
    page = stage.page(SyntheticSource(bumps, seconds=0.4, rest=0.0, limit=30))
    expect(page.locator("#stroke-30")).to_be_visible()
    yield "thirty", page
    page.locator("#stroke-27").click()
    expect(page.locator("#image-note")).to_have_text("stroke 27")
    yield "picked", page
    page.keyboard.press("l")
    expect(page.locator("#visit-map")).to_be_visible()
    yield "map-of-thirty", page


def nothing_found(stage: Stage) -> Iterator[Shown]:
    source = SyntheticSource([Bump(kind="none", base_kPa=3.6)], seconds=1.0, limit=0)
    page = stage.page(source)
    expect(page.locator("#link-text")).to_have_text("Connected")
    source.limit = 1
    expect(page.locator("#stroke-1")).to_be_visible()
    yield "none", page


def no_model(stage: Stage) -> Iterator[Shown]:
    from palpate.sim.probe.over_lump import strokes_over

    felt, calibration = strokes_over("d12h07e20f09", "typical", 5, 150, 1, steady=True, press=True)
    probe = stage.stack.enter_context(EmulatedProbe("cpython", strokes=felt, calibration=calibration))
    page = stage.page(LiveSource(probe.port))
    expect(page.locator("#stroke-1")).to_be_visible()
    yield "no-model", page
    page.locator("[data-do=flash]").first.click()
    expect(page.locator("#flash-file")).to_be_visible()
    yield "flash", page


def at_the_end_of(recording: Path) -> Callable[[Stage], Iterator[Shown]]:
    def replay(stage: Stage) -> Iterator[Shown]:
        page = stage.page(ReplaySource(recording), mode="replay", load_strokes=load_strokes)
        expect(page.locator("#ticks .stroke").first).to_be_attached()
        yield "replay", page
        page.keyboard.press("Shift+ArrowRight")
        for _ in range(60):
            page.keyboard.press("Shift+ArrowRight")
        page.wait_for_timeout(3000)
        yield "replay-end", page

    return replay


def pictures(page: Page, path: Path) -> None:
    """The page at every width."""
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        settled(page)
        page.screenshot(path=path.with_name(f"{path.name}-{width}.png"))


def main(out: Path, recording: Path, only: set[str]) -> None:
    """Draw them."""
    out.mkdir(parents=True, exist_ok=True)
    expect.set_options(timeout=1000 * PATIENCE_S)
    acts = (before_the_first_stroke, strokes, a_long_visit, nothing_found, no_model, at_the_end_of(recording))
    with (
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=chromium(), args=CHROMIUM_OPTIONS) as browser,
    ):
        for scheme in ("dark", "light"):
            for act in acts:
                if only and not {act.__name__, scheme} <= only:
                    continue
                with ExitStack() as stack:
                    for name, page in act(Stage(browser, scheme, stack)):
                        pictures(page, out / f"{name}-{scheme}")
                        print(f"{name}, {scheme}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), set(sys.argv[3:]))
