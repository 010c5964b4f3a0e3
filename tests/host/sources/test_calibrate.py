"""An array that keeps nothing is calibrated here: zero, points, curves, dead cells, drift."""

import json
import time

import numpy as np
import pytest

from palpate import Probe
from palpate.cli import main
from palpate.errors import UsageError
from palpate.sim.probe.endpoints import PtyEndpoint
from palpate.sources import flexitac as wire
from palpate.sources.emulated import Speaker
from palpate.sources.kept import Kept, drift
from palpate.wire.cells import SHAPE
from palpate.wire.events import Frame, Log
from tests.host.sources.arrays import AIR, port_of, uniform

RNG = np.random.default_rng(5)
EXPONENT = RNG.uniform(0.5, 0.9, SHAPE)
GAIN = RNG.uniform(0.7, 1.0, SHAPE)
ZERO = RNG.uniform(8, 30, SHAPE)
DEAD = (3, 7)


def cells(kPa):
    """Cells of a piezoresistive matrix, no two alike, and one that is dead."""
    raw = ZERO + 200 * GAIN * np.clip(kPa / 20, 0, 1) ** EXPONENT + RNG.normal(0, 0.5, SHAPE)
    raw[DEAD] = ZERO[DEAD]
    return wire.frame(raw)


def calibrate(capsys, *words):
    """What the command prints as JSON."""
    assert main(["calibrate", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def pressed(speaker, port, kPa):
    """What a stream tells of a press, and its log."""
    with Probe.open(port) as probe:
        speaker.show([uniform(kPa)])
        frames, said = [], ""
        for event in probe.stream(timeout_s=60):
            if isinstance(event, Log):
                said += event.text + "; "
            elif isinstance(event, Frame):
                frames.append(event.pressure_kPa)
                if len(frames) == 40:
                    return np.mean(frames[20:], axis=0), said
    raise AssertionError("the stream ended")


def test_a_zero_under_a_moving_hand_is_refused(tmp_path, capsys):
    with Speaker(PtyEndpoint(), cells, [AIR, uniform(4.0)] * 5, rate_Hz=200) as speaker:
        kept = tmp_path / "mine.json"
        assert main(["calibrate", "zero", "--port", port_of(speaker, keep=kept)]) == 2
    assert "this is no zero: the mean reading wanders by" in capsys.readouterr().err
    assert not kept.exists()


def test_three_pressures_give_each_cell_its_curve(tmp_path, capsys):
    with Speaker(PtyEndpoint(), cells, [AIR], rate_Hz=200) as speaker:
        port = port_of(speaker, keep=tmp_path / "mine.json")
        assert main(["calibrate", "gain", "--pressure", "2", "--port", port]) == 2
        assert "take the zero first" in capsys.readouterr().err
        zero = calibrate(capsys, "zero", "--port", port)
        assert zero["noise"] == pytest.approx(0.5, abs=0.2) and zero["points_kPa"] == []
        assert main(["calibrate", "gain", "--pressure", "2", "--port", port]) == 2
        assert "nothing presses" in capsys.readouterr().err
        for kPa in (2.0, 5.0, 12.0):
            speaker.show([uniform(kPa)])
            done = calibrate(capsys, "gain", "--pressure", str(kPa), "--port", port)
        assert done["points_kPa"] == [2.0, 5.0, 12.0] and done["dead_cells"] == 1
        print(f"curves miss the three points by {done['misfit_kPa']:.3f} kPa")
        assert done["misfit_kPa"] < 0.1
        seen, said = pressed(speaker, port, 8.0)  # which it has not been told
        print(f"8 kPa: {seen.mean():.3f} kPa, cells {seen.std():.3f}")
        assert seen.mean() == pytest.approx(8.0, abs=0.1) and seen.std() < 0.15
        assert seen[DEAD] == pytest.approx(8.0, abs=0.5)  # of its neighbours
        assert "a guess" not in said and "its zero is 0 min old" in said
    assert main(["calibrate", "clear", "--port", port]) == 0
    assert not (tmp_path / "mine.json").exists()


def test_drift_is_told_in_pascals_a_minute(capsys, tmp_path):
    began = time.monotonic()

    def warming(kPa):
        return wire.frame(20 + 4 * (time.monotonic() - began) + RNG.normal(0, 0.5, SHAPE))

    with Speaker(PtyEndpoint(), warming, [AIR], rate_Hz=200) as speaker:
        port = port_of(speaker, keep=tmp_path / "no.json")
        found = calibrate(capsys, "drift", "--seconds", "2", "--port", port)
    assert found["Pa_per_minute"] == pytest.approx(60_000 * 4 * 25 / 255, rel=0.1)
    assert found["recalibrate_after_min"] == pytest.approx(100 / found["Pa_per_minute"])
    times_s = np.linspace(0, 60, 50)
    assert drift(times_s, 0.002 * times_s[:, None] + np.zeros(3)).Pa_per_minute == pytest.approx(120.0)


def test_a_calibration_that_is_none_or_anothers_is_refused(tmp_path):
    path = tmp_path / "kept.json"
    for text in ("{", "[]", '{"rows": 16}', '{"rows": 2, "columns": 2, "air": [1, 2]}',
                 '{"rows": 1, "columns": 1, "air": [NaN]}',
                 '{"rows": 1, "columns": 1, "air": [1], "points": [{"kPa": 0, "rise": [1]}]}'):  # fmt: skip
        path.write_text(text)
        with pytest.raises(UsageError, match="is no calibration of an array"):
            Kept.load(path, 1, 1)
    Kept(2, 2, [1.0] * 4).save(path)
    with pytest.raises(UsageError, match="of an array of 2 x 2, not 16 x 26"):
        Kept.load(path, 16, 26)


def test_doctor_looks_at_an_array_too(tmp_path, capsys):
    with Speaker(PtyEndpoint(), cells, [AIR], rate_Hz=100) as speaker:
        main(["doctor", "--port", port_of(speaker, keep=tmp_path / "no.json"), "--json"])
    found = {each["name"]: each for each in json.loads(capsys.readouterr().out)}
    assert "a second of" in found["frames"]["found"] and found["rails"]["state"] == "ok"
