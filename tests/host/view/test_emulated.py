"""The whole way: firmware in its interpreter, the link, the viewer, a real browser."""

from __future__ import annotations

import os

import pytest
from playwright.sync_api import expect

from palpate import models
from palpate.link import emulated as notes
from palpate.link.flash import flash
from palpate.link.probe import Probe
from palpate.link.session import recorded
from palpate.recording.playback import open_recording
from palpate.view.live import LiveSource
from palpate.view.replay import ReplaySource
from palpate.wire.events import Estimate, Gap
from tests.host.view.card import numbers_of, numbers_on
from tests.host.view.pages import pick
from tests.host.view.waiting import PATIENCE_S, eventually, noticed, recording_begun, recording_ended, see

pytestmark = pytest.mark.browser


@pytest.fixture
def probe(emulated, images):
    """An emulated probe with a model, strokes without end, on a TCP port that outlives an unplug."""
    made = emulated("cpython", listen="tcp:127.0.0.1:0", repeat=True, serial=b"LEFTHAND")
    with Probe.open(made.port) as client:
        flash(client, images[0])
    return made


def test_a_stroke_appears_and_the_card_says_what_the_probe_said(probe, viewer, open_page, tmp_path):
    running = viewer(LiveSource(probe.port))
    page = open_page(running)
    expect(page.locator("#link-text")).to_have_text("Connected")
    expect(page.locator("#device")).to_contain_text("LEFTHAND")
    recording_begun(page)
    see(page, '[data-step="stroke"].on')  # these strokes know no rest
    see(page, "#map-legend", "fit by the probe")
    expect(page.locator("#stroke-3")).to_be_visible()
    recording_ended(page)
    (file,) = (tmp_path / "recordings").glob("*.mcap")
    with open_recording(file) as recorded:
        said = {e.stroke: e for e in recorded.events() if isinstance(e, Estimate)}
    assert said

    def numbers() -> dict[float, int]:
        known = running.session.visits.strokes()
        return {round(s.estimate.time_us * 1e-6, 3): s.number for s in known if s.estimate is not None}

    times = {round(e.time_us * 1e-6, 3) for e in said.values()}
    eventually(lambda: times <= set(numbers()))  # the file may be ahead of the page
    by_time = numbers()
    for estimate in said.values():
        number = by_time[round(estimate.time_us * 1e-6, 3)]
        pick(page, number)
        expect(page.locator("#estimate-which")).to_contain_text(f"stroke {number},")
        assert numbers_on(page) == numbers_of(estimate)
        expect(page.locator("#card .foot")).to_contain_text(estimate.model_id.hex())


def test_what_the_probe_found_damaged_is_shown(emulated, rotten_store, viewer, open_page):
    """Of a probe's store only a lost calibration was ever seen here."""
    page = open_page(viewer(LiveSource(emulated("cpython", store=rotten_store, repeat=True).port)))
    expect(page.locator("#link-text")).to_have_text("Connected")
    expect(page.locator("#banner")).to_have_text("The probe found damaged in its store: settings.")


@pytest.mark.parametrize("of", ["live", "recorded"])
def test_a_document_of_another_model_is_not_passed_over_in_silence(probe, viewer, open_page, tmp_path, of):
    """The page showed neither width nor layer, and did not say why."""
    document = models.load()
    if of == "live":
        page = open_page(viewer(LiveSource(probe.port, document)))
    else:
        with recorded(probe.port, tmp_path / "visit.mcap") as client:
            list(client.stream(strokes=1, timeout_s=PATIENCE_S))
        page = open_page(viewer(ReplaySource(tmp_path / "visit.mcap", document), mode="replay"))
    expect(page.locator("#banner")).to_have_text(
        "The document that was named is not of the model that answers, and is not used: width and place "
        "across, the layer, and why a stroke is outside what the model knows are not shown."
    )


def test_health_is_shown_and_nothing_is_lost(probe, viewer, open_page):
    page = open_page(viewer(LiveSource(probe.port)))
    expect(page.locator("#h-latency")).not_to_have_text("–")
    expect(page.locator("#h-rate")).not_to_have_text("0")
    expect(page.locator("#h-lost")).to_have_text("0")
    expect(page.locator("#h-crc")).to_have_text("0")


def test_unplugged_it_says_so_and_plugged_in_again_it_goes_on(probe, viewer, open_page, tmp_path):
    page = open_page(viewer(LiveSource(probe.port)))
    expect(page.locator("#stroke-1")).to_be_visible()
    recording_begun(page)
    begun = page.locator("#strokes [data-number]").count()
    expect(page.locator(f"#stroke-{begun + 1}")).to_be_visible()
    probe.cut_power()
    probe.unplug()
    expect(page.locator("#banner")).to_contain_text("The probe is gone")
    expect(page.locator("body")).to_have_attribute("data-link", "gone")
    seen = page.locator("#strokes [data-number]").count()
    probe.start()
    expect(page.locator("#banner")).to_be_hidden()
    expect(page.locator(f"#stroke-{seen + 1}")).to_be_visible()
    recording_ended(page)
    (file,) = (tmp_path / "recordings").glob("*.mcap")
    with open_recording(file) as recorded:
        gaps = [e for e in recorded.events() if isinstance(e, Gap)]
    assert [g.ended for g in gaps] == [False, True] and gaps[1].restarted


def test_a_page_opened_before_the_probe_is_there_waits_for_it(emulated, viewer, open_page):
    made = emulated("cpython", listen="tcp:127.0.0.1:0")
    port = made.port
    made.cut_power()
    page = open_page(viewer(LiveSource(port)))
    expect(page.locator("#banner")).to_contain_text("Trying again")
    made.start()
    expect(page.locator("#link-text")).to_have_text("Connected")
    expect(page.locator("#card .verdict")).to_have_text("No model on the probe")


def test_the_page_puts_a_model_on_a_probe_that_has_none(emulated, viewer, open_page, images, tmp_path):
    """The page held the port, and told its reader to use another program that needs it."""
    made = emulated("cpython", listen="tcp:127.0.0.1:0", repeat=True)
    page = open_page(viewer(LiveSource(made.port)))
    expect(page.locator("#card .verdict")).to_have_text("No model on the probe")
    broken, whole = tmp_path / "broken.palp", tmp_path / "whole.palp"
    broken.write_bytes(images[0][:-1] + b"?")
    whole.write_bytes(images[0])
    page.locator("#card button").click()
    page.locator("#flash-file").set_input_files(broken)
    expect(page.locator("#flash-state")).to_contain_text("signature does not fit")
    page.locator("#flash-file").set_input_files(whole)
    noticed(page, "The probe has model")
    expect(page.locator("#card .verdict")).not_to_have_text("No model on the probe")
    expect(page.locator("#device")).to_contain_text("model ")


def test_where_any_probe_will_do_a_replaced_one_is_found(emulated, viewer, open_page):
    """A restarted emulator, or another board on the bench, was never found again."""
    first = emulated("cpython", listen="tcp:127.0.0.1:0", repeat=True, serial=b"FIRST001")
    note = notes.leave(notes.Note(first.port, os.getpid(), "d10h08e10f10", "cpython"))
    page = open_page(viewer(LiveSource("auto")))
    expect(page.locator("#device")).to_contain_text("FIRST001")
    note.unlink()
    first.stop()
    expect(page.locator("#link-text")).to_have_text("Probe gone")
    second = emulated("cpython", listen="tcp:127.0.0.1:0", repeat=True, serial=b"SECOND02")
    notes.leave(notes.Note(second.port, os.getpid(), "d10h08e10f10", "cpython"))
    expect(page.locator("#device")).to_contain_text("SECOND02")
    expect(page.locator("#link-text")).to_have_text("Connected")
