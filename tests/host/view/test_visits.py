"""`palpate view --data`: what visits differ by themselves reaches the page's comparison."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
from playwright.sync_api import expect

from palpate import models
from palpate.importing import importer
from palpate.learn import data
from palpate.link import emulator_model as emulator
from palpate.sim.probe.sensors import LEVELS, SensorModel
from tests.host.learn.conftest import STROKES
from tests.host.probes import DECLARED, arrays_of
from tests.host.processes import start_palpate

VISITS = 3


@pytest.fixture(scope="module")
def visits(tmp_path_factory):
    """One lump visited three times, two strokes each; zero and gain were taken anew each time."""
    home = tmp_path_factory.mktemp("visits")
    field = data.read_strokes(STROKES).lumps[17].field
    rows = ["recording,stroke,lump,visit,d_mm"]
    for visit in range(1, VISITS + 1):
        felt = [SensorModel(field, LEVELS["typical"], 10 * visit + n).stroke(40) for n in (1, 2)]
        np.savez(home / f"visit-{visit}.npz", **arrays_of(felt))
        name = f"visit-{visit}.mcap"
        importer.import_file(home / f"visit-{visit}.npz", home / name, DECLARED, emulator.image(models.TOLD))
        rows += [f"{name},{n},A,{visit},{felt[0].truth.outputs()['d_mm']:.3f}" for n in (1, 2)]
    (home / "set.csv").write_text("\n".join(rows) + "\n")
    return home


@pytest.fixture
def started(visits):
    """Starts `palpate view` on the second visit, and ends it."""
    running = []

    def start(*more):
        process = start_palpate(
            "view", visits / "visit-2.mcap", "--no-browser", "--http-port", 0, "--recordings", visits, *more
        )
        running.append(process)
        return SimpleNamespace(url=re.search(r"http://\S+", process.stdout.readline()).group())

    yield start
    for process in running:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("given", [True, False], ids=["with a data set", "without"])
def test_the_page_s_interval_counts_what_visits_differ_by(visits, started, open_page, given):
    page = open_page(started(*(("--data", visits / "set.csv") if given else ())))
    expect(page.locator("#ticks .stroke")).to_have_count(2)
    expect(page.locator("#strokes [data-number]")).to_have_count(2)
    page.locator("#load-visit").click()
    page.get_by_role("button", name="visit-1.mcap").click()
    expect(page.locator("#visit-a option:checked")).to_have_text("visit-1")
    told = page.locator("#comparison")
    if given:
        expect(told.locator(".result")).to_contain_text("what visits differ by")
        expect(told).to_contain_text("how visits to lumps that had not changed differed in the data set")
    else:
        expect(told.locator(".result")).to_contain_text("repeatability")
        expect(told).to_contain_text("take for granted that the probe was the same on both visits")


def test_a_data_set_without_a_second_visit_is_one_sentence(visits, palpate, tmp_path):
    lines = (visits / "set.csv").read_text().splitlines()[:3]
    (tmp_path / "set.csv").write_text("\n".join(lines).replace("visit-1.mcap", str(visits / "visit-1.mcap")))
    status, _, err = palpate("view", visits / "visit-2.mcap", "--data", tmp_path / "set.csv", "--no-browser")
    assert status == 2 and "2 lumps visited again, or one 3 times, are needed" in err and err.count("\n") == 1
