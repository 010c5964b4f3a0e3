"""Creep and hysteresis of somebody else's array, measured under a cuff that nobody pumps on the frame."""

import json
from dataclasses import replace

import numpy as np
import pytest

from palpate.cli import main
from palpate.sim.probe.noise import LEVELS
from palpate.sim.probe.sensors import SensorModel, StrokeField
from palpate.sim.tissue import Case, simulate_forces
from palpate.sim.tissue.settings import Settings
from palpate.wire.cells import SHAPE
from palpate.wire.scale import NOMINAL
from tests.host.sources.arrays import flexitac, port_of

TRUE = replace(LEVELS["typical"], creep=0.03, hysteresis=0.02, dead=0.0, stuck=0.0)
COURSE = [[0, 0], [0.6, 0], [0.6, 12], [1.8, 12], [2.6, 0], [3.0, 0], [3.4, 8], [4.2, 0], [4.6, 0]]
RATE_HZ = 50


@pytest.fixture(scope="module")
def cells():
    """Makes images of what the same cells feel of one pressure after the other."""
    case = Case.without_lump(15.0, 0.6)
    field = StrokeField(*simulate_forces(case, [0.5, 0.7], Settings(start_mm=0.0, press_only=True)))

    def felt(p):
        time_s = np.arange(len(p)) / RATE_HZ
        even = np.broadcast_to(p[:, None, None], (len(p), *SHAPE))
        counts, *_ = SensorModel(field, TRUE, 5).felt(even, 0 * time_s, 60 * time_s, 0 * time_s)
        whole = np.clip(np.rint(counts), 0, 4095).astype(np.uint16)
        return [NOMINAL.kPa(each).astype(float).reshape(SHAPE) for each in whole]

    return felt


@pytest.mark.long  # the course is felt in real time, which other tests beside it distort
def test_creep_and_hysteresis_of_an_array_come_back_from_two_courses(cells, tmp_path, capsys):
    """The stream begins when it will: the course is found in the frames, a second off or not."""
    times, levels = np.array(COURSE, float).T
    frames_s = np.arange(0, times[-1], 1 / RATE_HZ)
    course = np.interp(frames_s, times + 1e-6 * np.arange(len(times)), levels)
    said = ""
    with flexitac(cells(np.zeros(100))) as speaker:
        port = port_of(speaker, keep=tmp_path / "mine.json")
        assert main(["calibrate", "zero", "--port", port]) == 0
        for kPa in (2.0, 5.0, 12.0):
            speaker.show(cells(np.full(200, kPa)))
            assert main(["calibrate", "gain", "--pressure", str(kPa), "--port", port]) == 0
        for k in range(2):
            speaker.show(cells(np.concatenate([np.zeros(30 + 20 * k), course, np.zeros(100)])))
            out = str(tmp_path / f"cuff{k}.mcap")
            assert main(["stream", "--port", port, "--seconds", "5.5", "--record", out, "--json"]) == 0
            said += f'[[recording]]\nfile = "cuff{k}.mcap"\nkind = "cuff"\nkPa = {COURSE}\n'
    (tmp_path / "campaign.toml").write_text(said)
    capsys.readouterr()
    words = [
        "characterise",
        str(tmp_path / "campaign.toml"),
        "--out",
        str(tmp_path / "sensor.toml"),
        "--json",
    ]
    assert main(words) == 0
    noise = json.loads(capsys.readouterr().out)["noise"]
    assert noise["creep"] == pytest.approx(TRUE.creep, abs=0.012)
    assert noise["hysteresis"] == pytest.approx(TRUE.hysteresis, abs=0.012)
    assert noise["common_gain"] < 0.02  # the calibration has taken it out
