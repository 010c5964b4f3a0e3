"""The reference board, emulated in one shell, and every command that a user has for it in another.

Nothing here knows that it is some hundred times slower than a real one: what the commands do about it is what
anybody's do (`palpate.link.emulated.Note.times_slower`).
"""

import json
import re
import signal
from types import SimpleNamespace

import pytest
from playwright.sync_api import expect

from palpate.link import emulated as notes
from palpate.sim.probe.emulated import BOARD_START_S
from tests.host.conftest import bench, images, specs
from tests.host.probes import FRAMES, LUMP
from tests.host.processes import start_palpate
from tests.host.view.conftest import browser, launch, open_page

__all__ = ["bench", "browser", "images", "launch", "open_page", "specs"]
pytestmark = [pytest.mark.board, pytest.mark.long, pytest.mark.browser, pytest.mark.timeout(0)]

PATIENCE_S = 3 * BOARD_START_S


@pytest.fixture
def port(key_dir):
    """Of a board that knows a key and has no model yet."""
    words = ("--board", "rp2040", "--key", key_dir, "--frames", FRAMES, "--json")
    with start_palpate("emulate", LUMP, *words) as process:
        told = process.stdout.readline()
        assert told, process.stderr.read()
        yield json.loads(told)["port"]
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130


def test_devices_doctor_flash_stream_replay_and_view_work_with_it_as_with_a_real_one(
    port, palpate, images, open_page, tmp_path
):
    """Each command gave the board up after six seconds, a third of one of its own."""
    seen = [f"a second of the board took {notes.times_slower(port):g} s here"]
    code, said, _ = palpate("devices", "--json")
    (found,) = (device for device in json.loads(said) if device["port"] == port)
    assert found["state"] == "probe" and found["model_id"] == ""

    code, said, wrong = palpate("doctor", "--port", port, "--json")  # while a hand strokes
    frames = next(finding for finding in json.loads(said) if finding["name"] == "frames")
    seen.append(f"doctor: {frames['found']}")
    assert frames["state"] == "ok", frames

    model, visit = tmp_path / "model.palp", tmp_path / "visit.mcap"
    model.write_bytes(images[0])
    code, said, wrong = palpate("flash", model, "--port", port, "--json")
    assert code == 0, wrong
    flashed = json.loads(said)
    seen.append(f"flash: {flashed['size']} bytes")

    code, said, wrong = palpate("stream", "--port", port, "--strokes", 1, "--record", visit, "--json")
    assert code == 0, wrong
    told = json.loads(said)
    (estimate,) = told["strokes"]
    assert estimate["model_id"] == flashed["model_id"]
    lost = {
        name: told["link"][name] for name in ("frames_lost", "probe_frames_dropped", "probe_frames_overrun")
    }
    seen.append(f"stream: {told['link']['frames_received']} frames, {lost}")
    assert set(lost.values()) == {0}
    code, said, wrong = palpate("replay", visit)
    assert code == 0 and said.splitlines()[-1].startswith("replay: identical"), said + wrong

    words = ("--port", port, "--no-browser", "--http-port", 0, "--recordings", tmp_path / "recordings")
    with start_palpate("view", *words) as view:
        url = re.search(r"http://localhost:\d+/\?token=[\w-]+", view.stdout.readline())
        page = open_page(SimpleNamespace(url=url[0]))
        patience = {"timeout": 1000 * PATIENCE_S}
        expect(page.locator("#link-text")).to_have_text("Connected", **patience)
        expect(page.locator("#h-rate")).not_to_have_text("0", **patience)
        expect(page.locator("#map-legend")).to_contain_text("fit by the probe", **patience)
        expect(page.locator("#stroke-1")).to_be_visible(**patience)
        expect(page.locator("#card .foot")).to_contain_text(estimate["model_id"], **patience)
        expect(page.locator("#h-lost")).to_have_text("0")
        seen.append(f"view: {' '.join(page.locator('#card').inner_text().split())}")
        view.send_signal(signal.SIGINT)
        view.communicate(timeout=PATIENCE_S)
    print("\n".join(seen))
