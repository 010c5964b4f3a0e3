"""The reference press from the page: what to do, what came of it, and forgetting it."""

import pytest
from playwright.sync_api import expect

from palpate.model_export.exporter import export
from palpate.sim.probe.over_lump import reference_beside, strokes_over
from palpate.view.live import LiveSource
from palpate.view.serve import Viewer
from tests import reference_model
from tests.host.conftest import emulated
from tests.host.probes import LUMP

__all__ = ["emulated"]

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def bench():
    beside = reference_beside(LUMP, "typical", 1)
    strokes, calibration = strokes_over(LUMP, "typical", 1, 40, 1, press=True)
    return [beside, *strokes], calibration


def test_it_is_taken_in_a_pause_of_the_stream_kept_and_forgotten(emulated, browser, real_key_dir, tmp_path):
    image = export(reference_model.model(), real_key_dir)[0]
    with (
        emulated(model=image) as probe,
        Viewer(LiveSource(probe.port), mode="live", recordings=tmp_path, token="") as viewer,
    ):
        page = browser.new_page()
        page.goto(viewer.url)
        button, dialog = page.locator("#reference"), page.locator("#dialog-reference")
        expect(button).to_have_attribute("aria-pressed", "false")
        button.click()
        expect(page.locator("#reference-kept")).to_have_text("The probe keeps none yet.")
        page.locator("#reference-begin").click()
        expect(page.locator("#reference-state")).to_contain_text("waits for the press")
        expect(page.locator("#toasts")).to_contain_text("Reference press: fat of")
        expect(dialog).to_be_hidden()
        expect(button).to_have_attribute("aria-pressed", "true")
        expect(page.locator("#stroke-1")).to_be_visible()  # the stream goes on
        page.keyboard.press("p")
        expect(page.locator("#reference-kept")).to_contain_text("mm thick")
        page.locator("#reference-forget").click()
        expect(button).to_have_attribute("aria-pressed", "false")
        page.close()


def test_a_model_that_takes_none_shows_no_button(emulated, browser, tmp_path):
    with (
        emulated() as probe,
        Viewer(LiveSource(probe.port), mode="live", recordings=tmp_path, token="") as viewer,
    ):
        page = browser.new_page()
        page.goto(viewer.url)
        expect(page.locator("#link-text")).to_have_text("Connected")
        expect(page.locator("#reference")).to_be_hidden()
        page.close()
